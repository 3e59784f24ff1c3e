//! The contents of the recording's folder: frames, depth, lists, profile, ground truth.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use glam::{DQuat, DVec3};
use image::ImageError;
use image::codecs::hdr::HdrEncoder;
use toml_edit::{DocumentMut, Item, Table, Value};

use crate::camera::{CameraExposure, Lens, LensModel, NoiseBin, NoiseProfile};
use crate::document::{numbers, table_of};
use crate::frame::FrameExposure;
use crate::params::Params;
use crate::pose::Pose;
use crate::profile;
use crate::recording::write::{
    self, CameraFile, CameraKind, DepthList, Description, ExposureList, FrameFiles, Line, Placement, PoseFile,
};

use super::depth::DepthSensor;
use super::encoded::{self, depth_png, encoding, extension};
use super::output::{Output, writing};
use super::site::lamp;
use super::stray::{self, Scan};
use super::survey::noise_through_file;
use super::written::{TRUTH, Written, sealed};
use super::{Format, Layout, Options, SimulateError, Simulation, board};

/// Film speed given in the profile for a noise scale of 1.
const ISO: f64 = 400.0;
/// Size of the panorama of the site's light, and the position it is taken from, metres.
const PANORAMA: (u32, u32) = (256, 128);
const PANORAMA_AT_M: DVec3 = DVec3::new(0.0, 0.0, 0.1);

/// Simulates a recording into the folder `out`, which appears once it is complete. An existing simulated recording is
/// replaced if `force` is set; any other folder never is, unless it is empty. `progress` is called with (frames done,
/// total), first with (0, total). If it breaks, the work stops and nothing is left of it.
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
    fill(output.folder(), output.name(), &simulation, progress).map_err(|error| output.told(error))?;
    output.finish()
}

fn fill(
    folder: &Path,
    name: &str,
    simulation: &Simulation,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    let options = simulation.options();
    let mut written = Written::default();
    let mut save = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        written.add(name, bytes);
        fs::write(&path, bytes).map_err(writing(&path))
    };
    let is_scan = options.layout == Some(Layout::Stray);
    for sub in if is_scan { stray::FOLDERS } else { ["rgb", "depth"] } {
        fs::create_dir_all(folder.join(sub)).map_err(writing(folder))?;
    }
    let frames = options.frames as usize;
    let sensor = DepthSensor::new(simulation)?;
    let mut scan = if is_scan { Some(Scan::begin(folder, simulation)?) } else { None };
    let (mut pictures, mut depths, mut exposures) = (Vec::new(), Vec::new(), Vec::new());
    let mut blur = Vec::new();
    let mut surveyed = Vec::new();
    for frame in 0..frames {
        let picture = simulation.picture(frame);
        let clean = simulation.sensor.clean(&picture, options.gain);
        let codes = simulation.sensor.sense(&clean, picture.width as usize, frame as u64, simulation.threads);
        let measured = sensor.as_ref().map(|sensor| sensor.picture(simulation, frame));
        let depth = measured.as_ref().unwrap_or(&picture);
        if let Some(scan) = &mut scan {
            let files = scan.add(simulation, frame, codes, depth)?;
            files.into_iter().try_for_each(|(name, bytes)| save(&name, &bytes))?;
        } else {
            let (time_s, extension) = (rounded(simulation.timestamp_s(frame), 6), extension(options.format));
            let (rgb_path, depth_path) = (format!("rgb/{frame:05}.{extension}"), format!("depth/{frame:05}.png"));
            save(&rgb_path, &encoded::frame(options, &picture, &codes).map_err(encoding(&rgb_path))?)?;
            save(&depth_path, &depth_png(depth, options.depth_scale).map_err(encoding(&depth_path))?)?;
            pictures.push((time_s, rgb_path));
            depths.push((time_s, depth_path));
            // An instant gathers no light; the profile records that it is one.
            let exposure_s = Some(options.exposure_time_s).filter(|time_s| *time_s > 0.0);
            exposures.push((time_s, FrameExposure { time_s: exposure_s, gain: Some(1.0), ..FrameExposure::default() }));
        }
        blur.push(picture.most_blur_px);
        let is_surveyed = !is_scan && options.format == Format::Jpg;
        if is_surveyed && [frames / 6, frames / 2, 5 * frames / 6].contains(&frame) {
            surveyed.push((picture, clean));
        }
        if progress(frame + 1, frames).is_break() {
            return Err(SimulateError::Stopped);
        }
    }
    let list = |entries: &[(f64, String)]| {
        write::pictures(entries.iter().map(|(time_s, name)| (*time_s, name.as_str()))).map_err(SimulateError::Text)
    };
    match scan {
        Some(scan) => {
            let (video, files) = scan.finish(simulation)?;
            files.into_iter().try_for_each(|(name, bytes)| save(&name, &bytes))?;
            save("rgb.mp4", &fs::read(&video).map_err(writing(&video))?)?;
        }
        None => {
            save("rgb.txt", list(&pictures)?.as_bytes())?;
            save("depth.txt", list(&depths)?.as_bytes())?;
            save("exposure.txt", write::exposures(&exposures).as_bytes())?;
            save("groundtruth.txt", trajectory(simulation).as_bytes())?;
            save("recording.toml", recording_toml(name, options, sensor.as_ref())?.as_bytes())?;
            if let Some(sensor) = sensor.as_ref().filter(|sensor| sensor.beside_m.is_some()) {
                save(DEPTH_CAMERA, depth_camera_toml(sensor).as_bytes())?;
            }
        }
    }
    save("environment.hdr", &panorama(simulation).map_err(encoding("environment.hdr"))?)?;
    if options.board {
        save("board.glb", &board().glb().map_err(encoding("board.glb"))?)?;
    }
    let noise = match surveyed.first() {
        None => simulation.sensor.profile(),
        Some((like, _)) => {
            let pictures: Vec<_> = surveyed.iter().map(|(_, clean)| clean.clone()).collect();
            noise_through_file(simulation, &pictures, |codes| {
                let file = encoded::frame(options, like, &codes)?;
                Ok(image::load_from_memory(&file)?.into_rgb8().into_raw())
            })
            .map_err(encoding("a frame for measuring noise"))?
        }
    };
    save("camera.toml", camera_toml(simulation, &noise).as_bytes())?;
    let path = folder.join(TRUTH);
    fs::write(&path, truth_toml(simulation, &blur, &written)).map_err(writing(&path))
}

/// Micrometres, nanoseconds and the like: anything below is rounding noise.
fn rounded(value: f64, digits: usize) -> f64 {
    // Via text, which rounds correctly at every magnitude.
    format!("{value:.digits$}").parse().unwrap_or(value)
}

fn trajectory(simulation: &Simulation) -> String {
    let line = |(time_s, pose): &(f64, Pose)| {
        let line = Line::new(*time_s, pose);
        let rotation = DQuat::from_array(line.rotation.to_array().map(|v| rounded(v, 12)));
        let position_m = DVec3::from_array(line.position_m.to_array().map(|v| rounded(v, 9)));
        Line { time_s: rounded(*time_s, 6), position_m, rotation }
    };
    write::trajectory(&simulation.track().poses().iter().map(line).collect::<Vec<_>>())
}

/// The site's light around the evidence as a Radiance file: equirectangular, row 0 looks up (+z), the middle column
/// along +y, columns to the right towards +x.
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

/// The description of a depth camera of its own.
const DEPTH_CAMERA: &str = "depth.toml";

fn depth_camera_toml(sensor: &DepthSensor) -> String {
    let mut profile = profile::Document::new("The simulated depth camera.");
    profile.set_params(&sensor.geometry.intrinsics);
    profile.to_string()
}

fn recording_toml(name: &str, options: &Options, sensor: Option<&DepthSensor>) -> Result<String, SimulateError> {
    let beside_m = sensor.and_then(|sensor| sensor.beside_m);
    let placed = |at_m: DVec3| Placement { position_m: at_m.to_array(), quaternion: [0.0, 0.0, 0.0, 1.0] };
    let profile = Some("camera.toml".into());
    let kind = (options.lens == LensModel::Equirectangular).then_some(CameraKind::Equirectangular);
    let description = write::description(Description {
        version: 1,
        name: Some(name.to_owned()),
        up: Some([0.0, 0.0, 1.0]),
        floor: false,
        frames: FrameFiles { list: Some("rgb.txt".into()), ..FrameFiles::default() },
        poses: PoseFile { trajectory: Some("groundtruth.txt".into()), ..PoseFile::default() },
        depth: Some(DepthList {
            list: "depth.txt".into(),
            scale: options.depth_scale,
            camera: beside_m.map(|_| DEPTH_CAMERA.into()),
            colour_from_depth: beside_m.map(placed),
        }),
        exposure: Some(ExposureList { list: "exposure.txt".into() }),
        camera: Some(CameraFile { profile, kind }),
        live: None,
    });
    let description = description.map_err(|e| SimulateError::Text(e.to_string()))?;
    Ok(format!("# A simulated recording; truth.toml tells how it was made.\n{description}"))
}

fn numbers_in(values: impl IntoIterator<Item = f64>, digits: usize) -> Value {
    numbers(values.into_iter().map(|v| rounded(v, digits)))
}

/// To a thousandth of a code, which is finer than the measurement.
fn rounded_noise(noise: &NoiseProfile) -> NoiseProfile {
    let bin = |bin: &NoiseBin| NoiseBin { code: rounded(bin.code, 1), sigma: rounded(bin.sigma, 3) };
    NoiseProfile {
        bins: noise.bins.each_ref().map(|bins| bins.iter().map(bin).collect()),
        channel_correlation: noise.channel_correlation.map(|v| rounded(v, 3)),
        neighbour_correlation: noise.neighbour_correlation.map(|v| rounded(v, 3)),
    }
}

fn camera_toml(simulation: &Simulation, noise: &NoiseProfile) -> String {
    let options = simulation.options();
    let lens = Lens { aperture_diameter_mm: Some(0.0), ..Lens::default() };
    let exposure =
        CameraExposure { time_s: Some(options.exposure_time_s), iso: Some(ISO), ..CameraExposure::default() };
    let origin = match options.format {
        Format::Jpg if options.layout.is_none() => "as measured in the compressed frames",
        Format::Png | Format::Jpg => "as the sensor was told to make it",
    };
    let mut profile =
        profile::Document::new(&format!("The simulated camera. Noise: σ in 8-bit code values, {origin}."));
    let geometry = simulation.geometry();
    let tables: [&dyn Params; 5] =
        [&geometry.intrinsics, &geometry.distortion, &lens, &exposure, &simulation.sensor.response];
    tables.into_iter().for_each(|table| profile.set_params(table));
    profile.set_noise(&rounded_noise(noise), "");
    profile.to_string()
}

/// A table with a comment above it.
fn said(mut table: Table, comment: &str) -> Item {
    table.decor_mut().set_prefix(if comment.is_empty() { "\n".to_owned() } else { format!("\n# {comment}\n") });
    Item::Table(table)
}

fn truth_toml(simulation: &Simulation, blur: &[f64], written: &Written) -> String {
    let mut text = DocumentMut::new();
    text.insert("version", toml_edit::value(1));
    text.insert("most_blur_px", Item::Value(numbers_in(blur.iter().copied(), 2)));
    let comments = [
        ("version", "# How this recording was made.\n"),
        (
            "most_blur_px",
            "\n# The longest way that anything takes across the picture during a row's exposure, a frame each.\n",
        ),
    ];
    for (key, comment) in comments {
        if let Some(mut key) = text.key_mut(key) {
            key.leaf_decor_mut().set_prefix(comment);
        }
    }
    let options = simulation.options();
    text.insert(options.table(), said(table_of(options), ""));
    let values = [
        ("centre_m", numbers_in(lamp::CENTRE_M.to_array(), 3)),
        ("half_size_m", numbers_in(lamp::HALF_M, 3)),
        ("radiance", numbers_in(lamp::RADIANCE.to_array(), 3)),
    ];
    let comment = "The only lamp: a rectangle in the ceiling that shines down; linear light, 1 is camera white.";
    text.insert("lamp", said(values.into_iter().collect(), comment));
    let before_file = profile::noise_table(&rounded_noise(&simulation.sensor.profile()));
    text.insert("noise_before_file", said(before_file, "σ before rounding and compression."));
    if options.board {
        let corners = board().corners_in_world_m.map(|corner| numbers_in(corner.to_array(), 4));
        let board = Table::from_iter([("corners_in_world_m", Value::Array(corners.into_iter().collect()))]);
        text.insert("board", said(board, ""));
    }
    let comment = "Length, bytes, and crc32 of the other files: what differs is not replaced.";
    text.insert("files", said(written.table(), comment));
    sealed(&text.to_string())
}
