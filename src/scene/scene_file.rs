//! Adds the contents of a scene file to a scene.

use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};

use super::document::{Instance, LampTable, LightTable, PlacedModel, Scale, SceneFile, SunTable};
use super::edit;
use super::light::{DEFAULT_WHITE_LX, SUN_RAD, default_lighting};
use super::loaded_models::{MissingModels, Model, Panorama};
use super::loader::Loader;
use super::missing;
use super::panorama::PanoramaPixels;
use super::place::{FilePlacement, Size, shortest_rotation};
use super::site::read_site;
use super::{
    Environment, EnvironmentMap, LightingOrigin, Object, ObjectKind, PointLight, SceneError, Sun, model, panorama,
};

/// Adds the contents of a scene file to the loader. Errors name `file`, and models are found
/// relative to it.
pub(super) fn read(
    loader: &mut Loader,
    scene: &SceneFile,
    file: &Path,
    recording_up: Option<DVec3>,
) -> Result<(), SceneError> {
    scene.check(file)?;
    loader.scene.files.push(file.to_owned());
    let world_up = match scene.up {
        Some(up) => up.axis(file, "up")?,
        None => recording_up.unwrap_or(DVec3::Z),
    };
    loader.scene.up_in_world = Some(world_up);
    if let Some(metres_per_unit) = scene.metres_per_unit.filter(|m| !(*m > 0.0 && m.is_finite())) {
        return Err(SceneError::bad(file, "metres_per_unit", metres_per_unit, "more than 0"));
    }
    loader.scene.metres_per_unit = scene.metres_per_unit;
    if let Some(gauge) = scene.gauge.filter(|gauge| gauge.pose().is_none()) {
        let actual = format!("{:?} {:?}", gauge.position_m, gauge.quaternion);
        return Err(SceneError::bad(file, "gauge", actual, "a finite position and a quaternion of length 1"));
    }
    loader.scene.gauge = scene.gauge;
    loader.scene.site = scene.site.as_ref().map(|site| read_site(file, site)).transpose()?;
    let white_lx = scene.light.white_lx.unwrap_or(DEFAULT_WHITE_LX);
    if !(white_lx > 0.0 && white_lx.is_finite()) {
        return Err(SceneError::bad(file, "light.white_lx", white_lx, "more than 0"));
    }
    for (i, object) in scene.objects.iter().enumerate() {
        place(loader, file, object, &format!("objects[{i}] ({})", object.model), world_up, white_lx)?;
    }
    loader.warn_of_hidden();
    if scene.objects.is_empty() {
        loader.warn(file, "it has no [[objects]], so nothing is visible".to_owned());
    }
    let light = &scene.light;
    for (i, sun) in light.sun.iter().enumerate() {
        loader.scene.lighting.suns.push(read_sun(file, sun, &format!("light.sun[{i}]"))?);
    }
    for (i, lamp) in light.lamp.iter().enumerate() {
        loader.scene.lighting.points.push(read_lamp(file, lamp, &format!("light.lamp[{i}]"))?);
    }
    match (environment(loader, file, light, world_up)?, loader.scene.lighting.is_dark()) {
        (Some(environment), _) => loader.scene.lighting.environment = environment,
        (None, true) => {
            loader.scene.lighting = default_lighting(world_up);
            loader.scene.lighting_origin = LightingOrigin::Default;
        }
        (None, false) if light.sun.is_empty() && light.lamp.is_empty() => {
            loader.scene.lighting_origin = LightingOrigin::Models;
            loader.warn_of_dark_ambient(file);
        }
        (None, false) => loader.warn_of_dark_ambient(file),
    }
    Ok(())
}

fn place(
    loader: &mut Loader,
    file: &Path,
    object: &PlacedModel,
    location: &str,
    world_up: DVec3,
    white_lx: f64,
) -> Result<(), SceneError> {
    let path = file.parent().unwrap_or(Path::new("")).join(&object.model);
    let (model, is_missing) = match model_of(loader, file, object, location, &path)? {
        Some(model) => (model, false),
        None => (loader.stand_in_box(), true),
    };
    let model_up = match object.up {
        Some(up) => up.axis(file, &format!("{location}.up"))?,
        None => DVec3::Y,
    };
    let placement = |instance: Option<&Instance>, name: String, location: &str| -> Result<Object, SceneError> {
        let turned = |rotation_deg, quaternion| rotation(file, location, rotation_deg, quaternion);
        let sized = |scale, size_m| size(file, location, scale, size_m);
        // Missing values of an instance are those of the object.
        let own = instance.map(|i| Ok((turned(i.rotation_deg, i.quaternion)?, sized(i.scale, i.size_m)?)));
        let (own_rotation, own_size) = own.transpose()?.unwrap_or_default();
        let size = own_size.or(sized(object.scale, object.size_m)?).unwrap_or(Size::Scale(DVec3::ONE));
        let size = if is_missing { missing::size(size) } else { size };
        let position = instance.and_then(|i| i.position_m).or(object.position_m).unwrap_or([0.0; 3]);
        let rotation = own_rotation.or(turned(object.rotation_deg, object.quaternion)?).unwrap_or(DQuat::IDENTITY);
        let hidden = object.hidden || instance.is_some_and(|i| i.hidden);
        let shadowless = is_missing || object.shadowless || instance.is_some_and(|i| i.shadowless);
        let heading_deg = instance.and_then(|i| i.heading_deg).or(object.heading_deg).unwrap_or(0.0);
        let placement = FilePlacement {
            world_up,
            model_up,
            position_m: DVec3::from(position),
            rotation: DQuat::from_axis_angle(world_up, heading_deg.to_radians()) * rotation,
            ground: object.ground,
        };
        let transform = placement.world_from_model(&loader.scene, &model.parts, size);
        let world_from_model = transform.ok_or_else(|| {
            let actual = "numbers too large, or a model without extent";
            SceneError::bad(file, location, actual, "a place, a rotation and a size that fit the model")
        })?;
        let position_m = placement.position_m;
        let occluder = object.occluder && !is_missing;
        let by_file = if occluder { ObjectKind::Prop } else { ObjectKind::of_model(Path::new(&object.model)) };
        let kind = object.kind.unwrap_or(by_file);
        let of_file = Object { name, kind, hidden, occluder, shadowless, is_missing, ..Object::default() };
        Ok(Object { world_from_model, position_m, ..of_file })
    };
    let name = object.name.clone().unwrap_or_else(|| {
        Path::new(&object.model).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
    });
    let mut places = Vec::new();
    for (i, instance) in object.instances.iter().enumerate() {
        let own_name = instance.name.clone().unwrap_or_else(|| format!("{name} {}", i + 1));
        places.push(placement(Some(instance), own_name, &format!("{location}.instances[{i}]"))?);
    }
    if object.instances.is_empty() {
        places.push(placement(None, name, location)?);
    }
    for object in places {
        loader.place(&path, &model, object, white_lx)?;
    }
    Ok(())
}

/// The model of an object. `None` if it cannot be read and may be missing.
fn model_of(
    loader: &mut Loader,
    file: &Path,
    object: &PlacedModel,
    location: &str,
    path: &Path,
) -> Result<Option<Rc<Model>>, SceneError> {
    let are_hidden = !object.instances.is_empty() && object.instances.iter().all(|instance| instance.hidden);
    let is_needed = !(object.hidden || are_hidden);
    let stands_in = loader.missing_models == MissingModels::StandIn;
    if (stands_in || !is_needed) && loader.is_missing(path, is_needed) {
        return Ok(None);
    }
    let before = loader.counts();
    let read = if model::is_model(path) {
        model::load(loader, path, Some(file))
    } else {
        let accepted = "a .glb or .gltf file; Blender imports other models and exports .glb";
        Err(SceneError::bad(file, format!("{location}.model"), &object.model, accepted))
    };
    match read {
        Ok(model) => Ok(Some(model)),
        Err(error) => {
            loader.roll_back(before);
            loader.skip_missing(path, is_needed, error).map(|()| None)
        }
    }
}

fn size(file: &Path, location: &str, scale: Option<Scale>, size_m: Option<f64>) -> Result<Option<Size>, SceneError> {
    let scale = scale.map(|scale| match scale {
        Scale::All(s) => DVec3::splat(s),
        Scale::Each(s) => s.into(),
    });
    match (scale, size_m) {
        (None, None) => Ok(None),
        (Some(_), Some(_)) => Err(SceneError::bad(file, location, "scale and size_m", "one of them")),
        (Some(scale), None) if scale.is_finite() && scale.to_array().iter().all(|&s| s != 0.0) => {
            Ok(Some(Size::Scale(scale)))
        }
        (Some(scale), None) => Err(SceneError::bad(file, format!("{location}.scale"), scale, "numbers other than 0")),
        (None, Some(size_m)) if size_m > 0.0 && size_m.is_finite() => Ok(Some(Size::LargestM(size_m))),
        (None, Some(size_m)) => Err(SceneError::bad(file, format!("{location}.size_m"), size_m, "more than 0")),
    }
}

fn rotation(
    file: &Path,
    location: &str,
    rotation_deg: Option<[f64; 3]>,
    quaternion: Option<[f64; 4]>,
) -> Result<Option<DQuat>, SceneError> {
    match (rotation_deg.map(DVec3::from), quaternion.map(DQuat::from_array)) {
        (None, None) => Ok(None),
        (Some(_), Some(_)) => Err(SceneError::bad(file, location, "rotation_deg and quaternion", "one of them")),
        (Some(angles), None) if angles.is_finite() => Ok(Some(edit::rotation(angles))),
        (Some(angles), None) => {
            Err(SceneError::bad(file, format!("{location}.rotation_deg"), angles, "three finite numbers"))
        }
        (None, Some(q)) if (q.length() - 1.0).abs() < 0.01 => Ok(Some(q.normalize())),
        (None, Some(q)) => {
            Err(SceneError::bad(file, format!("{location}.quaternion"), format!("length {}", q.length()), "length 1"))
        }
    }
}

fn read_sun(file: &Path, sun: &SunTable, location: &str) -> Result<Sun, SceneError> {
    let towards = DVec3::from(sun.towards);
    let towards_light_in_world = towards
        .try_normalize()
        .ok_or_else(|| SceneError::bad(file, format!("{location}.towards"), towards, "a vector with a length"))?
        .as_vec3();
    let color = sun.color.map_or(Vec3::ONE, Vec3::from) * sun.intensity.unwrap_or(1.0) as f32;
    let diameter_rad = match sun.diameter_deg {
        None => SUN_RAD,
        Some(deg) if (0.0..=170.0).contains(&deg) => deg.to_radians() as f32,
        Some(deg) => return Err(SceneError::bad(file, format!("{location}.diameter_deg"), deg, "0 to 170")),
    };
    let color = positive(file, &format!("{location}.color · intensity"), color)?;
    Ok(Sun { towards_light_in_world, color, diameter_rad })
}

fn read_lamp(file: &Path, lamp: &LampTable, location: &str) -> Result<PointLight, SceneError> {
    let color = lamp.color.map_or(Vec3::ONE, Vec3::from) * lamp.intensity.unwrap_or(1.0) as f32;
    let color = positive(file, &format!("{location}.color · intensity"), color)?;
    let diameter_m = match lamp.diameter_or_default_m() {
        diameter_or_default_m if (0.0..=100.0).contains(&diameter_or_default_m) => diameter_or_default_m as f32,
        diameter_m => return Err(SceneError::bad(file, format!("{location}.diameter_m"), diameter_m, "0 to 100")),
    };
    let at_m = lamp.at_m.into();
    Ok(PointLight { position_in_world_m: at_m, color, diameter_m, range_m: f32::INFINITY, spot: None })
}

fn positive(file: &Path, location: &str, color: Vec3) -> Result<Vec3, SceneError> {
    if color.is_finite() && color.min_element() >= 0.0 {
        return Ok(color);
    }
    Err(SceneError::bad(file, location, color, "0 or more"))
}

/// The file's environment or ambient light, if any.
fn environment(
    loader: &mut Loader,
    file: &Path,
    light: &LightTable,
    world_up: DVec3,
) -> Result<Option<Environment>, SceneError> {
    let Some(name) = &light.environment else {
        let unused = [
            ("environment_intensity", light.environment_intensity.is_some()),
            ("environment_color", light.environment_color.is_some()),
            ("environment_rotation_deg", light.environment_rotation_deg.is_some()),
            ("environment_up", light.environment_up.is_some()),
        ];
        if let Some((key, _)) = unused.iter().find(|(_, is_set)| *is_set) {
            return Err(SceneError::bad(file, format!("light.{key}"), "no light.environment", "both or neither"));
        }
        let ambient = light.ambient.map(|color| positive(file, "light.ambient", color.into())).transpose()?;
        return Ok(ambient.map(Environment::Uniform));
    };
    if light.ambient.is_some() {
        return Err(SceneError::bad(file, "light", "environment and ambient", "one of them"));
    }
    let color = light.environment_color.map_or(Vec3::ONE, Vec3::from);
    let color = color * light.environment_intensity.unwrap_or(1.0) as f32;
    let color = positive(file, "light.environment_color · environment_intensity", color)?;
    let degrees = light.environment_rotation_deg.unwrap_or(0.0);
    if !degrees.is_finite() {
        return Err(SceneError::bad(file, "light.environment_rotation_deg", degrees, "a finite number"));
    }
    let path = file.parent().unwrap_or(Path::new("")).join(name);
    let read = loader.panorama(&path, || {
        let (PanoramaPixels { width, height, rgb }, warning) = panorama::read(&path, file)?;
        Ok(Panorama { width, height, rgb: Arc::new(rgb), warning })
    });
    let Panorama { width, height, rgb, warning } = match read {
        Ok(panorama) => panorama,
        Err(error) => return loader.skip_missing(&path, true, error).map(|()| None),
    };
    loader.scene.files.push(path.clone());
    if let Some(warning) = warning {
        loader.warn(&path, warning);
    }
    if width != 2 * height {
        loader.warn(&path, format!("{width}×{height} pixels: a whole panorama is twice as wide as high"));
    }
    let up = light.environment_up.map_or(Ok(world_up), |up| up.axis(file, "light.environment_up"))?;
    let world_from_map = DQuat::from_axis_angle(up, degrees.to_radians()) * shortest_rotation(DVec3::Y, up);
    let map_from_world = world_from_map.conjugate().as_quat().normalize();
    Ok(Some(Environment::Map(EnvironmentMap { width, height, rgb, map_from_world, color })))
}
