//! Environment light of the scene: panorama, ambient light and suns.

use eframe::egui::{self, RichText, Ui};
use glam::{DVec3, Vec3};

use super::Project;
use super::fields::{color_picker, rounded, row};
use locard_engine::scene::document::{Color, LightTable, SunTable};
use locard_engine::text::count;

/// Elevation of a new sun, degrees.
const NEW_SUN_DEG: f64 = 55.0;
/// Signal of a white Lambertian surface that faces a new sun.
const NEW_SUN_INTENSITY: f64 = 0.6;
/// Smallest brightness of ambient light in the panel, so that it keeps its colour.
const MIN_BRIGHTNESS: f64 = 1e-4;

/// Shows the controls of the scene file's light, or offers to write the current light into the
/// scene. Returns an error.
pub fn show(ui: &mut Ui, project: &mut Project) -> Option<String> {
    if project.is_lit_by_models() {
        ui.label(RichText::new("Lights inside the models light the scene.").weak());
        return None;
    }
    if project.edit().scene.light.is_unspecified() {
        return offer(ui, project);
    }
    let wrong = fields(ui, project);
    ui.horizontal_wrapped(|ui| {
        let mut wrong = None;
        let ambient = "The same light from everywhere, as bright from above as the panorama.";
        let has_panorama = project.edit().scene.light.environment.is_some();
        if has_panorama && ui.button("Even light").on_hover_text(ambient).clicked() {
            wrong = project.make_light_uniform().err();
        }
        if ui.button("Add sun").clicked() {
            wrong = wrong.or(add_sun(project).err());
        }
        wrong
    })
    .inner
    .or(wrong)
}

fn offer(ui: &mut Ui, project: &mut Project) -> Option<String> {
    let (text, button) = match project.found_light() {
        Some(light) => {
            let lamps = light.lamps.iter().filter(|lamp| !lamp.is_bounce()).count();
            let lamps = if lamps == 0 { "no lamps".to_owned() } else { count(lamps, "lamp") };
            (format!("Light from the footage: panorama, {lamps}."), "Copy to scene and edit")
        }
        None => ("Default light: the room's lighting is unknown.".to_owned(), "Edit light"),
    };
    ui.label(RichText::new(text).weak());
    let hint = "Writes that light into the scene, where it can be changed.";
    let is_taken = ui.button(button).on_hover_text(hint).clicked();
    if is_taken { project.adopt_light().err() } else { None }
}

fn fields(ui: &mut Ui, project: &mut Project) -> Option<String> {
    let before = project.edit().scene.light.clone();
    let mut light = before.clone();
    let up = project.up();
    let mut removed = None;
    let mut done = ui.input(|i| i.pointer.any_released());
    egui::Grid::new("room light").num_columns(2).spacing([8.0, 3.0]).show(ui, |ui| {
        if light.environment.is_some() {
            done |= panorama(ui, &mut light);
        }
        if let Some(ambient) = &mut light.ambient {
            ui.label("even light").on_hover_text("Its light on white matt surfaces");
            colour(ui, "even light colour", ambient);
            ui.end_row();
            let mut brightness = max_channel(*ambient);
            done |= row(ui, "brightness", "even light brightness", &mut brightness, 0.005, "");
            if brightness != max_channel(*ambient) {
                *ambient = with_brightness(*ambient, brightness.max(MIN_BRIGHTNESS));
            }
        }
        for (n, sun) in light.sun.iter_mut().enumerate() {
            done |= sun_fields(ui, n, sun, up);
            ui.label("");
            if ui.button("Delete sun").clicked() {
                removed = Some(n);
            }
            ui.end_row();
        }
    });
    let what = match removed {
        Some(n) => format!("sun {}: deleted", n + 1),
        None => "light: changed".to_owned(),
    };
    if let Some(n) = removed {
        light.sun.remove(n);
    }
    // A scene file without light would get the default light.
    if light.is_unspecified() {
        light.ambient = Some(Color::Grey(0.0));
    }
    let changed = (light != before).then(|| project.change_scene(&what, |scene| scene.light = light).err());
    if done || removed.is_some() {
        project.close_step();
    }
    changed.flatten().map(|error| error.to_string())
}

/// Returns true at the end of a change.
fn panorama(ui: &mut Ui, light: &mut LightTable) -> bool {
    let (mut intensity, mut turn_deg) =
        (light.environment_intensity.unwrap_or(1.0), light.environment_rotation_deg.unwrap_or(0.0));
    let before = (intensity, turn_deg);
    let mut color = light.environment_color.unwrap_or(Color::Grey(1.0));
    ui.label("panorama").on_hover_text("Factors on its light");
    let is_coloured = colour(ui, "panorama colour", &mut color);
    ui.end_row();
    let speed = 0.01 * intensity.max(0.1);
    let mut done = row(ui, "brightness", "panorama brightness", &mut intensity, speed, "");
    done |= row(ui, "turn", "panorama turn", &mut turn_deg, 1.0, "°");
    if is_coloured {
        light.environment_color = Some(color);
    }
    if intensity != before.0 {
        light.environment_intensity = Some(rounded(intensity.max(0.0)));
    }
    if turn_deg != before.1 {
        light.environment_rotation_deg = Some(rounded(turn_deg));
    }
    done
}

/// Returns true at the end of a change.
fn sun_fields(ui: &mut Ui, n: usize, sun: &mut SunTable, up: DVec3) -> bool {
    let name = format!("sun {}", n + 1);
    let before = angles_deg(DVec3::from(sun.towards), up);
    let ([mut height_deg, mut azimuth_deg], mut intensity) = (before, sun.intensity.unwrap_or(1.0));
    let mut color = sun.color.unwrap_or(Color::Grey(1.0));
    ui.label(&name);
    if colour(ui, &format!("{name} colour"), &mut color) {
        sun.color = Some(color);
    }
    ui.end_row();
    let mut done = row(ui, "brightness", &format!("{name} brightness"), &mut intensity, 0.005, "");
    done |= row(ui, "height", &format!("{name} height"), &mut height_deg, 0.5, "°");
    done |= row(ui, "direction", &format!("{name} direction"), &mut azimuth_deg, 1.0, "°");
    if intensity != sun.intensity.unwrap_or(1.0) {
        sun.intensity = Some(rounded(intensity.max(0.0)));
    }
    if [height_deg, azimuth_deg] != before {
        sun.towards = direction([height_deg.clamp(-90.0, 90.0), azimuth_deg], up).to_array().map(rounded);
    }
    done
}

fn add_sun(project: &mut Project) -> Result<(), String> {
    let towards = direction([NEW_SUN_DEG, 0.0], project.up()).to_array().map(rounded);
    let sun = SunTable { towards, color: None, intensity: Some(NEW_SUN_INTENSITY), diameter_deg: None };
    project.change_scene("sun: added", |scene| scene.light.sun.push(sun)).map_err(|error| error.to_string())?;
    project.close_step();
    Ok(())
}

/// Direction of azimuth 0: the world's x axis, or y if x is up.
fn level_axis(up: DVec3) -> DVec3 {
    let axis = if up.x.abs() > 0.9 { DVec3::Y } else { DVec3::X };
    axis.reject_from_normalized(up).normalize()
}

/// Elevation, and azimuth counter-clockwise seen from above.
fn angles_deg(towards: DVec3, up: DVec3) -> [f64; 2] {
    let (towards, axis) = (towards.normalize_or(up), level_axis(up));
    let azimuth = towards.dot(up.cross(axis)).atan2(towards.dot(axis));
    [towards.dot(up).clamp(-1.0, 1.0).asin(), azimuth].map(f64::to_degrees)
}

fn direction(angles_deg: [f64; 2], up: DVec3) -> DVec3 {
    let [height, azimuth] = angles_deg.map(f64::to_radians);
    let axis = level_axis(up);
    height.sin() * up + height.cos() * (azimuth.cos() * axis + azimuth.sin() * up.cross(axis))
}

fn rgb(color: Color) -> [f64; 3] {
    match color {
        Color::Grey(value) => [value; 3],
        Color::Rgb(rgb) => rgb,
    }
}

fn max_channel(color: Color) -> f64 {
    rgb(color).into_iter().fold(0.0, f64::max)
}

fn with_brightness(color: Color, brightness: f64) -> Color {
    match max_channel(color) {
        0.0 => Color::Grey(rounded(brightness)),
        before => Color::Rgb(rgb(color).map(|channel| rounded(channel * brightness / before))),
    }
}

/// A colour picker. Returns true if the colour changed.
fn colour(ui: &mut Ui, called: &str, color: &mut Color) -> bool {
    let mut channels = rgb(*color);
    color_picker(ui, called, &mut channels);
    let is_changed = channels != rgb(*color);
    if is_changed {
        *color = Color::Rgb(channels);
    }
    is_changed
}

/// Ambient light with the same signal of a white Lambertian surface.
pub fn ambient(shown: Vec3) -> LightTable {
    let ambient = Color::Rgb(shown.to_array().map(|channel| rounded(channel.into())));
    LightTable { ambient: Some(ambient), ..LightTable::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sun_angles_and_directions_are_inverse() {
        // At 30° over the horizon, a right angle from x: by hand (0, cos 30°, sin 30°).
        assert!(direction([30.0, 90.0], DVec3::Z).abs_diff_eq(DVec3::new(0.0, 0.75f64.sqrt(), 0.5), 1e-12));
        for up in [DVec3::Z, DVec3::X, DVec3::NEG_Y, DVec3::new(0.1, 0.8, 0.6).normalize()] {
            for angles in [[-20.0, 170.0], [0.0, 0.0], [55.0, -120.0]] {
                let angles_again = angles_deg(3.0 * direction(angles, up), up);
                assert!(
                    (0..2).all(|n| (angles_again[n] - angles[n]).abs() < 1e-9),
                    "{up}: {angles_again:?} {angles:?}"
                );
            }
        }
    }

    #[test]
    fn brightness_keeps_the_ratios_of_channels() {
        assert_eq!(with_brightness(Color::Rgb([0.5, 0.25, 0.1]), 1.0), Color::Rgb([1.0, 0.5, 0.2]));
        assert_eq!(with_brightness(Color::Grey(0.0), 0.3), Color::Grey(0.3));
    }
}
