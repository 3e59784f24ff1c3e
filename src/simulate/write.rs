//! Contents of the recording's folder: frames, depth, lists, profile, ground truth.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use glam::{DQuat, DVec3};
use image::ImageError;
use image::codecs::hdr::HdrEncoder;

use crate::camera::{CameraExposure, Lens, LensModel, NoiseProfile};
use crate::frame::FrameExposure;
use crate::params::Params;
use crate::pose::Pose;
use crate::profile;
use crate::recording::write::{
    self, CameraFile, CameraKind, DepthList, Description, ExposureList, FrameFiles, Line, PoseFile, SensorPose,
};
use crate::tracking::PoseTrack;

use super::depth::DepthSensor;
use super::encode::{self, depth_png, encoding, extension};
use super::local_tone::locally_tone_mapped;
use super::manifest::{Manifest, TRUTH};
use super::output::{RecordingOutput, writing};
use super::render::SimulatedPicture;
use super::static_scenes::noise_through_file;
use super::stray::{self, StrayScan};
use super::truth::{self, rounded, rounded_noise, truth_toml};
use super::{Flaws, FolderLayout, Format, Options, SimulateError, Simulation, board};

/// ISO speed in the profile for a noise scale of 1.
const ISO: f64 = 400.0;
/// Size of the panorama of the site's light, px.
const PANORAMA_SIZE_PX: (u32, u32) = (256, 128);
const PANORAMA_AT_M: DVec3 = DVec3::new(0.0, 0.0, 0.1);

/// Simulates a recording into the folder `out`, which appears once it is complete. An existing
/// simulated recording is replaced if `force` is set; any other folder is kept, unless it is empty.
/// `progress` is called with (frames done, total), first with (0, total). If it breaks, the work
/// stops and leaves no files.
pub fn run(
    out: &Path,
    options: &Options,
    flaws: &Flaws,
    force: bool,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    write(out, force, || Simulation::with_flaws(options, flaws), progress)
}

/// Writes any simulation like [`run`]. It is built after the folder was checked.
pub fn write(
    out: &Path,
    force: bool,
    simulate: impl FnOnce() -> Result<Simulation, SimulateError>,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    let output = RecordingOutput::begin(out, force)?;
    let simulation = simulate()?;
    if progress(0, simulation.options().frames as usize).is_break() {
        return Err(SimulateError::Stopped);
    }
    fill(output.folder(), output.name(), &simulation, progress).map_err(|error| output.with_final_path(error))?;
    output.finish()
}

fn fill(
    folder: &Path,
    name: &str,
    simulation: &Simulation,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    let (options, flaws) = (simulation.options(), simulation.flaws());
    let recorded = simulation.recorded_track()?;
    let mut files = FolderFiles::begin(folder, simulation)?;
    let frames = options.frames as usize;
    let sensor = DepthSensor::new(simulation)?;
    let mut scan = if files.is_scan() { Some(StrayScan::begin(folder, simulation)?) } else { None };
    let mut blur = Vec::new();
    let mut surveyed = Vec::new();
    let (mut codes, mut max_blur_px) = (Vec::new(), 0.0);
    for frame in 0..frames {
        let picture = locally_tone_mapped(simulation.picture(frame), flaws.local_tone_share);
        let clean = simulation.sensor.clean_balanced(&picture, simulation.gains(frame));
        if flaws.source_frame(frame) == frame {
            codes = simulation.sensor.sense(&clean, picture.width as usize, frame as u64, simulation.threads);
            max_blur_px = picture.max_blur_px;
        }
        let exact = sensor.as_ref().map(|sensor| sensor.exact(simulation, frame));
        let exact = exact.as_ref().unwrap_or(&picture);
        let measured = sensor.as_ref().and_then(|sensor| sensor.measured(simulation, frame, exact));
        let depth = measured.as_ref().unwrap_or(exact);
        if measured.is_some() {
            files.add_true_depth(frame, exact)?;
        }
        match &mut scan {
            Some(scan) => files.save_all(scan.add(simulation, &recorded, frame, codes.clone(), depth)?)?,
            None => files.add_frame(frame, &picture, &codes, depth)?,
        }
        blur.push(max_blur_px);
        let is_surveyed = scan.is_none() && options.format == Format::Jpg;
        if is_surveyed && [frames / 6, frames / 2, 5 * frames / 6].contains(&frame) {
            surveyed.push((picture, clean));
        }
        if progress(frame + 1, frames).is_break() {
            return Err(SimulateError::Stopped);
        }
    }
    match scan {
        Some(scan) => {
            let (video, described) = scan.finish(simulation)?;
            files.save_all(described)?;
            files.save("rgb.mp4", &fs::read(&video).map_err(writing(&video))?)?;
        }
        None => files.save_lists(name, &recorded, sensor.as_ref())?,
    }
    if flaws.is_any() {
        files.save_truth()?;
    }
    files.save("environment.hdr", &panorama(simulation).map_err(encoding("environment.hdr"))?)?;
    if options.board {
        files.save("board.glb", &board().glb().map_err(encoding("board.glb"))?)?;
    }
    let noise = match surveyed.first() {
        None => simulation.sensor.profile(),
        Some((like, _)) => {
            let pictures: Vec<_> = surveyed.iter().map(|(_, clean)| clean.clone()).collect();
            noise_through_file(simulation, &pictures, |codes| {
                let file = encode::frame(options, like, &codes)?;
                Ok(image::load_from_memory(&file)?.into_rgb8().into_raw())
            })
            .map_err(encoding("a frame for measuring noise"))?
        }
    };
    files.save("camera.toml", camera_toml(simulation, &noise).as_bytes())?;
    let path = folder.join(TRUTH);
    fs::write(&path, truth_toml(simulation, &blur, &files.manifest)).map_err(writing(&path))
}

/// Files of a recording's folder, and the future contents of its lists.
struct FolderFiles<'a> {
    folder: &'a Path,
    simulation: &'a Simulation,
    manifest: Manifest,
    pictures: Vec<(f64, String)>,
    depths: Vec<(f64, String)>,
    exposures: Vec<(f64, FrameExposure)>,
    true_depths: Vec<(f64, String)>,
}

impl<'a> FolderFiles<'a> {
    /// Creates the folders within.
    fn begin(folder: &'a Path, simulation: &'a Simulation) -> Result<Self, SimulateError> {
        let files = Self {
            folder,
            simulation,
            manifest: Manifest::default(),
            pictures: Vec::new(),
            depths: Vec::new(),
            exposures: Vec::new(),
            true_depths: Vec::new(),
        };
        let subs = if files.is_scan() { stray::FOLDERS } else { ["rgb", "depth"] };
        for sub in subs.into_iter().chain(simulation.flaws().is_any().then_some(truth::FOLDER)) {
            fs::create_dir_all(folder.join(sub)).map_err(writing(folder))?;
        }
        Ok(files)
    }

    fn is_scan(&self) -> bool {
        self.simulation.options().layout == Some(FolderLayout::Stray)
    }

    fn save(&mut self, name: &str, bytes: &[u8]) -> Result<(), SimulateError> {
        let path = self.folder.join(name);
        self.manifest.add(name, bytes);
        fs::write(&path, bytes).map_err(writing(&path))
    }

    fn save_all(&mut self, files: impl IntoIterator<Item = (String, Vec<u8>)>) -> Result<(), SimulateError> {
        files.into_iter().try_for_each(|(name, bytes)| self.save(&name, &bytes))
    }

    fn time_s(&self, frame: usize) -> f64 {
        rounded(self.simulation.timestamp_s(frame), 6)
    }

    /// The depth that a flawed sensor would have measured exactly.
    fn add_true_depth(&mut self, frame: usize, exact: &SimulatedPicture) -> Result<(), SimulateError> {
        let name = truth::depth_name(frame);
        let scale = if self.is_scan() { stray::CODES_PER_METRE } else { self.simulation.options().depth_scale };
        let file = depth_png(exact, scale).map_err(encoding(&name))?;
        self.save(&format!("{}/{name}", truth::FOLDER), &file)?;
        self.true_depths.push((self.time_s(frame), name));
        Ok(())
    }

    fn add_frame(
        &mut self,
        frame: usize,
        picture: &SimulatedPicture,
        codes: &[u8],
        depth: &SimulatedPicture,
    ) -> Result<(), SimulateError> {
        let (options, flaws) = (self.simulation.options(), self.simulation.flaws());
        let (time_s, extension) = (self.time_s(frame), extension(options.format));
        let (rgb_path, depth_path) = (format!("rgb/{frame:05}.{extension}"), format!("depth/{frame:05}.png"));
        self.save(&rgb_path, &encode::frame(options, picture, codes).map_err(encoding(&rgb_path))?)?;
        self.save(&depth_path, &depth_png(depth, options.depth_scale).map_err(encoding(&depth_path))?)?;
        self.pictures.push((time_s, rgb_path));
        self.depths.push((time_s, depth_path));
        // A zero exposure gathers no light; the profile still records it.
        let exposure_s = Some(options.exposure_time_s).filter(|time_s| *time_s > 0.0);
        // Automatic exposure is not recorded.
        let gain = (!flaws.is_automatic()).then_some(1.0);
        self.exposures.push((time_s, FrameExposure { time_s: exposure_s, gain, ..FrameExposure::default() }));
        Ok(())
    }

    fn save_lists(
        &mut self,
        name: &str,
        recorded: &PoseTrack,
        sensor: Option<&DepthSensor>,
    ) -> Result<(), SimulateError> {
        self.save("rgb.txt", list(&self.pictures)?.as_bytes())?;
        self.save("depth.txt", list(&self.depths)?.as_bytes())?;
        self.save("exposure.txt", write::exposures(&self.exposures).as_bytes())?;
        self.save("groundtruth.txt", trajectory(recorded).as_bytes())?;
        self.save("recording.toml", recording_toml(name, self.simulation.options(), sensor)?.as_bytes())?;
        match sensor.filter(|sensor| sensor.beside_m.is_some()) {
            Some(sensor) => self.save(DEPTH_CAMERA, depth_camera_toml(sensor).as_bytes()),
            None => Ok(()),
        }
    }

    /// The poses, frames and depth maps before the flaws.
    fn save_truth(&mut self) -> Result<(), SimulateError> {
        let (poses, frames) = truth::files(self.simulation);
        self.save(truth::POSES, trajectory(&poses).as_bytes())?;
        self.save(truth::FRAMES, frames.as_bytes())?;
        if self.true_depths.is_empty() {
            return Ok(());
        }
        self.save(truth::DEPTHS, list(&self.true_depths)?.as_bytes())
    }
}

fn list(entries: &[(f64, String)]) -> Result<String, SimulateError> {
    write::pictures(entries.iter().map(|(time_s, name)| (*time_s, name.as_str()))).map_err(SimulateError::Text)
}

fn trajectory(track: &PoseTrack) -> String {
    let line = |(time_s, pose): &(f64, Pose)| {
        let line = Line::new(*time_s, pose);
        let rotation = DQuat::from_array(line.rotation.to_array().map(|v| rounded(v, 12)));
        let position_m = DVec3::from_array(line.position_m.to_array().map(|v| rounded(v, 9)));
        Line { time_s: rounded(*time_s, 6), position_m, rotation }
    };
    write::trajectory(&track.poses().iter().map(line).collect::<Vec<_>>())
}

/// The site's light around the evidence as a Radiance file: equirectangular, row 0 is up (+z), the
/// middle column along +y, columns to the right towards +x.
fn panorama(simulation: &Simulation) -> Result<Vec<u8>, ImageError> {
    use std::f64::consts::{PI, TAU};
    const SIDE: u32 = 4;
    let (w, h) = PANORAMA_SIZE_PX;
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

/// Profile of a separate depth camera.
const DEPTH_CAMERA: &str = "depth.toml";

fn depth_camera_toml(sensor: &DepthSensor) -> String {
    let mut profile = profile::ProfileFile::new("The simulated depth camera.");
    profile.set_params(&sensor.geometry.intrinsics);
    profile.to_string()
}

fn recording_toml(name: &str, options: &Options, sensor: Option<&DepthSensor>) -> Result<String, SimulateError> {
    let beside_m = sensor.and_then(|sensor| sensor.beside_m);
    let placed = |at_m: DVec3| SensorPose { position_m: at_m.to_array(), quaternion: [0.0, 0.0, 0.0, 1.0] };
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
        camera: Some(CameraFile { profile, kind, list: None }),
        live: None,
    });
    let description = description.map_err(|e| SimulateError::Text(e.to_string()))?;
    Ok(format!("# A simulated recording; truth.toml has the ground truth.\n{description}"))
}

fn camera_toml(simulation: &Simulation, noise: &NoiseProfile) -> String {
    let options = simulation.options();
    let lens = Lens { aperture_diameter_mm: Some(0.0), ..Lens::default() };
    let exposure =
        CameraExposure { time_s: Some(options.exposure_time_s), iso: Some(ISO), ..CameraExposure::default() };
    let origin = match options.format {
        Format::Jpg if options.layout.is_none() => "as measured in the compressed frames",
        Format::Png | Format::Jpg => "as configured",
    };
    let mut profile =
        profile::ProfileFile::new(&format!("The simulated camera. Noise: σ in 8-bit code values, {origin}."));
    let geometry = simulation.geometry();
    let tables: [&dyn Params; 5] =
        [&geometry.intrinsics, &geometry.distortion, &lens, &exposure, &simulation.sensor.response];
    tables.into_iter().for_each(|table| profile.set_params(table));
    profile.set_noise(&rounded_noise(noise), "", Path::new(""));
    profile.to_string()
}
