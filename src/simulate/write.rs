//! What the recording's folder holds: frames, depth, lists, profile, ground truth.

use std::fmt::Write as _;
use std::fs;
use std::io::Cursor;
use std::ops::ControlFlow;
use std::path::Path;

use glam::DVec3;
use image::codecs::hdr::HdrEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageError};

use crate::camera::{Exposure, Lens, LensModel, NoiseProfile};
use crate::params::{Kind, Params, Value};

use super::output::{Output, writing};
use super::render::Picture;
use super::site::lamp;
use super::survey::noise_through_file;
use super::{Format, Options, SimulateError, Simulation, board};

/// Film speed that the profile states for a noise scale of 1.
const ISO: f64 = 400.0;
/// Size of the panorama of the site's light, and where it is taken, metres.
const PANORAMA: (u32, u32) = (256, 128);
const PANORAMA_AT_M: DVec3 = DVec3::new(0.0, 0.0, 0.1);

/// Simulates a recording into the folder `out`, which appears when it is whole. A simulated recording that exists is
/// replaced where `force` is set; another folder never is, unless it is empty. `progress` is told (frames done, of), first
/// (0, of); where it says so, the work stops and nothing is left of it.
pub fn run(
    out: &Path,
    options: &Options,
    force: bool,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    let output = Output::begin(out, force)?;
    let simulation = Simulation::new(options)?;
    if progress(0, options.frames as usize).is_break() {
        return Err(SimulateError::Stopped);
    }
    fill(output.folder(), output.name(), &simulation, progress)?;
    output.finish()
}

fn fill(
    folder: &Path,
    name: &str,
    simulation: &Simulation,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    let options = simulation.options();
    let save = |path: &str, bytes: &[u8]| {
        let path = folder.join(path);
        fs::write(&path, bytes).map_err(writing(&path))
    };
    for sub in ["rgb", "depth"] {
        fs::create_dir_all(folder.join(sub)).map_err(writing(folder))?;
    }
    let frames = options.frames as usize;
    let (mut rgb, mut depth) = ("# timestamp filename\n".to_owned(), "# timestamp filename\n".to_owned());
    let mut exposure = "# timestamp exposure_time_s gain\n".to_owned();
    let mut blur = Vec::new();
    let mut surveyed = Vec::new();
    for frame in 0..frames {
        let picture = simulation.picture(frame);
        let clean = simulation.sensor.clean(&picture, options.gain);
        let codes = simulation.sensor.sense(&clean, picture.width as usize, frame as u64, simulation.threads);
        let (time_s, extension) = (simulation.timestamp_s(frame), extension(options.format));
        let (rgb_path, depth_path) = (format!("rgb/{frame:05}.{extension}"), format!("depth/{frame:05}.png"));
        save(&rgb_path, &encoded(options, &picture, &codes).map_err(encoding(&rgb_path))?)?;
        save(&depth_path, &depth_png(&picture, options.depth_scale).map_err(encoding(&depth_path))?)?;
        _ = writeln!(rgb, "{time_s:.6} {rgb_path}");
        _ = writeln!(depth, "{time_s:.6} {depth_path}");
        _ = writeln!(exposure, "{time_s:.6} {} 1", options.exposure_time_s);
        blur.push(picture.most_blur_px);
        if options.format == Format::Jpg && [frames / 6, frames / 2, 5 * frames / 6].contains(&frame) {
            surveyed.push((picture, clean));
        }
        if progress(frame + 1, frames).is_break() {
            return Err(SimulateError::Stopped);
        }
    }
    save("rgb.txt", rgb.as_bytes())?;
    save("depth.txt", depth.as_bytes())?;
    save("exposure.txt", exposure.as_bytes())?;
    save("groundtruth.txt", trajectory(simulation).as_bytes())?;
    save("environment.hdr", &panorama(simulation).map_err(encoding("environment.hdr"))?)?;
    if options.board {
        save("board.glb", &board().glb().map_err(encoding("board.glb"))?)?;
    }
    let noise = match surveyed.first() {
        None => simulation.sensor.profile(),
        Some((like, _)) => {
            let pictures: Vec<_> = surveyed.iter().map(|(_, clean)| clean.clone()).collect();
            noise_through_file(simulation, &pictures, |codes| {
                let file = encoded(options, like, &codes)?;
                Ok(image::load_from_memory(&file)?.into_rgb8().into_raw())
            })
            .map_err(encoding("a frame for measuring noise"))?
        }
    };
    save("camera.toml", camera_toml(simulation, &noise).as_bytes())?;
    save("truth.toml", truth_toml(simulation, &blur).as_bytes())?;
    save("recording.toml", recording_toml(name, options).as_bytes())
}

fn encoding(what: &str) -> impl FnOnce(ImageError) -> SimulateError {
    let what = what.to_owned();
    move |source| SimulateError::Encode { what, source }
}

fn extension(format: Format) -> &'static str {
    match format {
        Format::Png => "png",
        Format::Jpg => "jpg",
    }
}

fn encoded(options: &Options, picture: &Picture, codes: &[u8]) -> Result<Vec<u8>, ImageError> {
    let (w, h) = (picture.width, picture.height);
    let mut file = Vec::new();
    match options.format {
        Format::Png => {
            let encoder = PngEncoder::new_with_quality(&mut file, CompressionType::Default, FilterType::Adaptive);
            encoder.write_image(codes, w, h, ExtendedColorType::Rgb8)?;
        }
        Format::Jpg => {
            let quality = options.jpeg_quality.clamp(1, 100) as u8;
            JpegEncoder::new_with_quality(&mut file, quality).encode(codes, w, h, ExtendedColorType::Rgb8)?;
        }
    }
    Ok(file)
}

/// 16-bit depth, `scale` a metre; 0 for nothing and for what lies beyond 65535.
fn depth_png(picture: &Picture, scale: f64) -> Result<Vec<u8>, ImageError> {
    let value = |depth_m: &f32| {
        let value = (f64::from(*depth_m) * scale).round();
        if (0.0..=65535.0).contains(&value) { value as u16 } else { 0 }
    };
    // The encoder takes 16-bit samples in the machine's own byte order.
    let bytes: Vec<u8> = picture.depth_m.iter().flat_map(|d| value(d).to_ne_bytes()).collect();
    let mut file = Cursor::new(Vec::new());
    PngEncoder::new_with_quality(&mut file, CompressionType::Best, FilterType::Adaptive).write_image(
        &bytes,
        picture.width,
        picture.height,
        ExtendedColorType::L16,
    )?;
    Ok(file.into_inner())
}

/// TUM's layout: camera to world, quaternion x y z w.
fn trajectory(simulation: &Simulation) -> String {
    let mut text = "# timestamp tx ty tz qx qy qz qw\n".to_owned();
    for (time_s, pose) in simulation.track().poses() {
        let (p, q) = (pose.position_in_world_m(), pose.world_from_camera_rotation());
        _ = writeln!(
            text,
            "{time_s:.6} {:.9} {:.9} {:.9} {:.12} {:.12} {:.12} {:.12}",
            p.x, p.y, p.z, q.x, q.y, q.z, q.w
        );
    }
    text
}

/// The site's light around the evidence as a Radiance file: equirectangular, row 0 looks up
/// (+z), the middle column along +y, columns further right more along +x.
fn panorama(simulation: &Simulation) -> Result<Vec<u8>, ImageError> {
    use std::f64::consts::{PI, TAU};
    const SIDE: u32 = 4;
    let (w, h) = PANORAMA;
    let pixel = |i: u32| {
        let mut sum = DVec3::ZERO;
        for k in 0..SIDE * SIDE {
            let x = f64::from(i % w) + (f64::from(k % SIDE) + 0.5) / f64::from(SIDE);
            let y = f64::from(i / w) + (f64::from(k / SIDE) + 0.5) / f64::from(SIDE);
            let ((sa, ca), (se, ce)) = ((TAU * (x / f64::from(w) - 0.5)).sin_cos(), (PI * y / f64::from(h)).sin_cos());
            sum += simulation.site.surroundings(PANORAMA_AT_M, DVec3::new(se * sa, se * ca, ce));
        }
        image::Rgb((sum / f64::from(SIDE * SIDE)).as_vec3().to_array())
    };
    let pixels: Vec<_> = (0..w * h).map(pixel).collect();
    let mut file = Vec::new();
    HdrEncoder::new(&mut file).encode(&pixels, w as usize, h as usize)?;
    Ok(file)
}

fn recording_toml(name: &str, options: &Options) -> String {
    format!(
        "# A simulated recording; truth.toml tells how it was made.\n\
         version = 1\n\
         name = {}\n\
         up = [0.0, 0.0, 1.0]\n\n\
         [frames]\nlist = \"rgb.txt\"\n\n\
         [poses]\ntrajectory = \"groundtruth.txt\"\n\n\
         [depth]\nlist = \"depth.txt\"\nscale = {:?}\n\n\
         [exposure]\nlist = \"exposure.txt\"\n\n\
         [camera]\nprofile = \"camera.toml\"\n{}",
        toml::Value::from(name),
        options.depth_scale,
        if options.lens == LensModel::Equirectangular { "kind = \"equirectangular\"\n" } else { "" }
    )
}

/// A table of parameters, from their declaration; those without a value are left out.
fn table(params: &dyn Params) -> String {
    let mut text = format!("\n[{}]\n", params.table());
    for spec in params.specs() {
        let value = match (params.get(spec.name), &spec.kind) {
            (Some(Value::Number(n)), Kind::Number { .. }) => format!("{n:?}"),
            (Some(Value::Number(n)), _) => format!("{n}"),
            (Some(Value::Bool(b)), _) => b.to_string(),
            (Some(Value::Text(t)), _) => toml::Value::from(t).to_string(),
            (Some(Value::None) | None, _) => continue,
        };
        _ = writeln!(text, "{} = {value}", spec.name);
    }
    text
}

fn numbers(values: impl IntoIterator<Item = f64>, digits: usize) -> String {
    format!("[{}]", values.into_iter().map(|v| format!("{v:.digits$}")).collect::<Vec<_>>().join(", "))
}

fn noise_tables(at: &str, noise: &NoiseProfile) -> String {
    let mut text = format!(
        "\n[{at}]\nchannel_correlation = {}\nneighbour_correlation = {}\ncode = {}\n",
        numbers(noise.channel_correlation, 3),
        numbers(noise.neighbour_correlation, 3),
        numbers(noise.bins[0].iter().map(|bin| bin.code), 1),
    );
    for (channel, name) in noise.bins.iter().zip(["sigma_r", "sigma_g", "sigma_b"]) {
        _ = writeln!(text, "{name} = {}", numbers(channel.iter().map(|bin| bin.sigma), 3));
    }
    text
}

fn camera_toml(simulation: &Simulation, noise: &NoiseProfile) -> String {
    let options = simulation.options();
    let lens = Lens { aperture_diameter_mm: Some(0.0), ..Lens::default() };
    let exposure = Exposure { time_s: Some(options.exposure_time_s), iso: Some(ISO), ..Exposure::default() };
    let origin = match options.format {
        Format::Png => "as the sensor was told to make it",
        Format::Jpg => "as measured in the compressed frames",
    };
    format!(
        "# The simulated camera. Noise: σ in 8-bit code values, {origin}.\nversion = 1\n{}{}{}{}{}{}",
        table(&simulation.geometry().intrinsics),
        table(&simulation.geometry().distortion),
        table(&lens),
        table(&exposure),
        table(&simulation.sensor.response),
        noise_tables("camera.noise", noise),
    )
}

fn truth_toml(simulation: &Simulation, blur: &[f64]) -> String {
    let mut text = format!(
        "# How this recording was made.\nversion = 1\n\n\
         # The longest way that anything takes across the picture during a row's exposure, a frame each.\n\
         most_blur_px = {}\n{}",
        numbers(blur.iter().copied(), 2),
        table(simulation.options()),
    );
    _ = write!(
        text,
        "\n# The only lamp: a rectangle in the ceiling that shines down; linear light, 1 is camera white.\n\
         [lamp]\ncentre_m = {}\nhalf_size_m = {}\nradiance = {}\n",
        numbers(lamp::CENTRE_M.to_array(), 3),
        numbers(lamp::HALF_M, 3),
        numbers(lamp::RADIANCE.to_array(), 3),
    );
    text += "\n# σ before rounding and compression.";
    text += &noise_tables("noise_before_file", &simulation.sensor.profile());
    if simulation.options().board {
        let corners = board().corners_in_world_m.map(|c| numbers(c.to_array(), 4)).join(", ");
        _ = write!(text, "\n[board]\ncorners_in_world_m = [{corners}]\n");
    }
    text
}
