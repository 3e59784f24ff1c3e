//! `locard inspect`.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use glam::DVec3;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::analysis::AnalysisArgs;
use super::open::Skip;
use super::pick::{self, Pick, Picker, PointQuery, plane};
use super::{clock, listen, progress_of};
use locard_engine::analyse;
use locard_engine::camera::Geometry;
use locard_engine::compositor::Settings;
use locard_engine::depth::unknown_fraction;
use locard_engine::document;
use locard_engine::frame::FrameExposure;
use locard_engine::params::{Field, Params, Value};
use locard_engine::profile::Rig;
use locard_engine::recording::{DepthRegistration, Duplicates, OpenOptions, Recording};
use locard_engine::shot::{AnalysisState, Shot, ShotError, ShotOptions};
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};
use locard_engine::stream::Protocol;
use locard_engine::text::{count, fixed, reason, short, shown, shown_unit};

#[derive(clap::Args)]
pub struct Args {
    /// A recording, a scene (.glb, .gltf, scene.toml), a profile, a scan (.e57, .ply …), or a
    /// stream: opentrackio://HOST:PORT, freed://HOST:PORT
    input: PathBuf,
    /// A frame of the recording
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = super::frame_number)]
    frame: Option<usize>,
    /// Column and row from the upper left, to find the world point there; repeat it for distances,
    /// three times for a plane. Without depth, also the same point in other frames
    #[arg(long = "pick", value_name = "X,Y[+N:X,Y]", requires = "frame", value_parser = Pick::parse)]
    picks: Vec<Pick>,
    /// Without depth: the plane a·x + b·y + c·z = d of the world that the points lie on
    #[arg(long, value_name = "A,B,C,D", requires = "picks", value_parser = plane, allow_hyphen_values = true)]
    plane: Option<[f64; 4]>,
    /// A scene file with a scan in its [site], which replaces measured depth for picks
    #[arg(long, value_name = "FILE", requires = "picks")]
    scene: Option<PathBuf>,
    /// The true distance of two picked points, for the length of a unit, for formats without a
    /// scale
    #[arg(long, value_name = "M", requires = "picks", allow_negative_numbers = true)]
    distance: Option<f64>,
    /// The camera, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, value_name = "M")]
    metres_per_unit: Option<f64>,
    /// Compare the pictures' motion with the poses', to find the offset of their clocks. Decodes
    /// every frame
    #[arg(long, conflicts_with = "frame")]
    clock: bool,
    #[command(flatten)]
    analysis: AnalysisArgs,
    #[command(flatten)]
    skip: Skip,
    /// Time for which a stream is received, from its first pose on
    #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = seconds)]
    seconds: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|seconds| (0.1..=86400.0).contains(seconds));
    number.ok_or_else(|| "expected a number of seconds from 0.1 to 86400".to_owned())
}

/// Maximum number of damaged pictures that are listed.
const MAX_LISTED_DAMAGED: usize = 10;

enum InputKind {
    Analysis,
    Recording,
    Scene,
    Profile,
    Scan,
}

/// The keys that identify the kind of a .toml file.
#[derive(Deserialize)]
struct Keys {
    frames: Option<IgnoredAny>,
    objects: Option<IgnoredAny>,
    light: Option<IgnoredAny>,
    site: Option<IgnoredAny>,
}

/// True for a calibration that OpenCV wrote as XML.
fn is_opencv_storage(path: &Path) -> bool {
    file::read_text(path, MAX_DOCUMENT_BYTES).is_ok_and(|text| text.contains("<opencv_storage"))
}

/// The kind of a file by its extension; of a .toml or .xml file by its contents.
fn kind(path: &Path) -> Result<InputKind> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    Ok(match ending.as_str() {
        _ if path.join(analyse::FILE_NAME).is_file() => InputKind::Analysis,
        _ if path.is_dir() => InputKind::Recording,
        "glb" | "gltf" => InputKind::Scene,
        "e57" | "las" | "laz" | "ply" | "obj" | "stl" | "xyz" | "pts" | "ptx" | "pcd" => InputKind::Scan,
        "yaml" | "yml" => InputKind::Profile,
        // Metashape's cameras are XML, too.
        "xml" if is_opencv_storage(path) => InputKind::Profile,
        "toml" => {
            let text = file::read_text(path, MAX_DOCUMENT_BYTES)
                .map_err(|error| anyhow!("{}: cannot be read: {}", path.display(), reason(&error)))?;
            let keys: Keys = document::read(&text).map_err(|problem| anyhow!("{}: {problem}", path.display()))?;
            if keys.frames.is_some() {
                InputKind::Recording
            } else if keys.objects.is_some() || keys.light.is_some() || keys.site.is_some() {
                InputKind::Scene
            } else {
                InputKind::Profile
            }
        }
        _ => InputKind::Recording,
    })
}

pub fn run(args: &Args) -> Result<()> {
    if let Some(url) = args.input.to_str().filter(|text| Protocol::of(text).is_some()) {
        if args.frame.is_some() {
            bail!("{url}: --frame needs a recording, but this is a stream");
        }
        return listen::run(url, args.seconds);
    }
    let input = kind(&args.input)?;
    if args.frame.is_some() && !matches!(input, InputKind::Recording) {
        bail!("{}: --frame needs a recording, and this is not one", args.input.display());
    }
    match input {
        InputKind::Scene => {
            let scene = locard_engine::scene::load(&args.input, None)?;
            write!(std::io::stdout().lock(), "{}", locard_engine::scene::describe(&scene))?;
            Ok(())
        }
        InputKind::Scan => {
            let scan = locard_engine::scene::read_scan(&args.input, args.metres_per_unit)?;
            let mut out = std::io::stdout().lock();
            writeln!(out, "scan       {}", scan.description())?;
            Ok(scan.warnings.iter().try_for_each(|text| writeln!(out, "odd        {text}"))?)
        }
        InputKind::Analysis => {
            write!(std::io::stdout().lock(), "{}", analyse::Analysis::read(&args.input)?.findings)?;
            Ok(())
        }
        InputKind::Profile => profile(&args.input),
        InputKind::Recording => recording(args),
    }
}

fn profile(path: &Path) -> Result<()> {
    let (mut rig, mut settings) = (Rig::default(), Settings::default());
    rig.read(path, &mut settings)?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "profile    {}", path.display())?;
    if let Some(Geometry { intrinsics: i, .. }) = rig.camera().geometry {
        writeln!(out, "picture    {}x{} px", i.width_px, i.height_px)?;
    }
    let tables: Vec<&dyn Params> = rig.tables().into_iter().chain(settings.tables()).collect();
    for table in tables {
        let changed = table.specs().into_iter().filter_map(|s| {
            let value = table.get(s.name)?;
            let unit = shown_unit(s.unit);
            let text = match value {
                Value::Number(n) => short(n),
                _ => value.to_string(),
            };
            (value != s.default).then(|| format!("{} = {text}{unit}", s.name))
        });
        let changed: Vec<_> = changed.collect();
        if !changed.is_empty() {
            writeln!(out, "[{}]  {}", table.table(), changed.join(", "))?;
        }
    }
    match &rig.noise {
        Some(noise) => {
            let sigmas = noise.bins.iter().flatten().map(|b| b.sigma);
            let (low, high) = sigmas.fold((f64::INFINITY, 0.0f64), |(l, h), s| (l.min(s), h.max(s)));
            writeln!(
                out,
                "noise      {}, σ {} to {} 8-bit codes; correlation of channels [{}], of neighbours [{}]",
                count(noise.bins[0].len(), "bin"),
                fixed(low, 2),
                fixed(high, 2),
                noise.channel_correlation.map(|c| fixed(c, 2)).join(", "),
                noise.neighbour_correlation.map(|c| fixed(c, 2)).join(", ")
            )?;
            match &noise.example {
                Some(example) => writeln!(out, "           by example: {}", example.file.display())?,
                None => writeln!(
                    out,
                    "           no examples: the pattern is drawn (`locard calibrate noise` or `locard analyse` makes examples)"
                )?,
            }
        }
        None => writeln!(
            out,
            "noise      not calibrated: virtual pixels will have none (`locard calibrate noise`, --moving from a recording)"
        )?,
    }
    match rig.missing_keys() {
        missing if missing.is_empty() => {}
        _ if !rig.gives_geometry() => writeln!(out, "odd        no intrinsics: the recording must have its own")?,
        missing => {
            let missing = missing.join(", ");
            writeln!(out, "odd        incomplete camera: without {missing} it overrides the recording's own")?;
        }
    }
    Ok(())
}

fn recording(args: &Args) -> Result<()> {
    let metres_per_unit = args.metres_per_unit.unwrap_or(1.0);
    let options = args.skip.apply_to(OpenOptions { metres_per_unit, ..OpenOptions::default() });
    // The given profile overrides the recording's own.
    let (profile, scene) = (args.profile.clone(), args.scene.clone());
    let shot_options = ShotOptions { profile, scene, analysis: args.analysis.choice(), ..ShotOptions::default() };
    let recording = Recording::open(&args.input, &options)?;
    let (shot, ()) = args.analysis.open(recording, &shot_options, false, |_| Ok(()))?;
    let mut out = std::io::stdout().lock();
    if let Some(frame) = args.frame {
        return one_frame(args, shot, frame, &mut out);
    }
    let geometry = match shot.geometry_at(0) {
        Err(ShotError::NoCamera { .. }) if args.profile.is_none() => None,
        geometry => Some(geometry?),
    };
    let recording = &shot.recording;
    let times = &recording.timestamps_s;
    let duration = times.last().zip(times.first()).map_or(0.0, |(b, a)| b - a);
    let posed = (0..recording.frame_count()).filter(|&i| recording.pose_at_frame(i).is_ok()).count();
    writeln!(out, "recording  {} ({})", shown(&recording.name), recording.kind)?;
    writeln!(
        out,
        "frames     {} of {}x{} px, {} bits; {} s, one every {} s",
        recording.frame_count(),
        recording.width,
        recording.height,
        recording.bits,
        fixed(duration, 3),
        fixed(recording.frame_interval_s, 4)
    )?;
    match recording.stored_format() {
        Ok(format) => writeln!(out, "format     {format}")?,
        Err(error) => writeln!(out, "format     unknown: {}", shown(&error.to_string()))?,
    }
    let response = shot.camera().response;
    writeln!(
        out,
        "colour     curve {}, primaries {}",
        Field::to_value(&response.curve),
        Field::to_value(&response.primaries)
    )?;
    let frames = recording.frame_count();
    writeln!(out, "poses      {}, for {posed} of {}", recording.track.poses().len(), count(frames, "frame"))?;
    writeln!(out, "depth      {}", depth(recording, geometry.is_some()))?;
    let exposed = recording.exposure.iter().filter(|e| e.reported_s().is_some()).count();
    match exposed {
        0 => writeln!(out, "exposure   unknown")?,
        _ => writeln!(
            out,
            "exposure   known for {exposed} of {}{}",
            count(frames, "frame"),
            exposure_ranges(&recording.exposure)
        )?,
    }
    let faded = (0..frames).filter(|&i| recording.opacity(i) < 1.0).count();
    if faded > 0 {
        writeln!(out, "opacity    below 1 in {faded} of {}: evidence fades there", count(frames, "frame"))?;
    }
    match &geometry {
        Some(g) if g.is_equirectangular() => writeln!(out, "camera     360°, longitude and latitude")?,
        Some(g) => writeln!(
            out,
            "camera     fx {} fy {} cx {} cy {} px",
            fixed(g.intrinsics.fx_px, 2),
            fixed(g.intrinsics.fy_px, 2),
            fixed(g.intrinsics.cx_px, 2),
            fixed(g.intrinsics.cy_px, 2)
        )?,
        None => writeln!(out, "camera     unknown: give a --profile")?,
    }
    match &shot.analysis {
        AnalysisState::Used(folder, findings) => {
            let folder = shown(&folder.display().to_string());
            writeln!(out, "analysis   {folder}: poses {}", findings.registration)?;
            for which in &findings.left_out {
                writeln!(out, "           {}", shown(which))?;
            }
        }
        AnalysisState::Unfit(folder, problem) => {
            let folder = shown(&folder.display().to_string());
            writeln!(out, "analysis   {folder} is not used: {}", shown(problem))?;
        }
        AnalysisState::Absent | AnalysisState::Ignored => {}
    }
    if args.clock {
        writeln!(out, "{}", clock::line(&shot)?)?;
    }
    let (files, damaged) = recording.check_ends();
    if files > 0 {
        let files = count(files, "picture");
        match damaged.len() {
            0 => writeln!(out, "files      {files}, none ends too early")?,
            1 => writeln!(out, "files      {files}, 1 cannot be read")?,
            more => writeln!(out, "files      {files}, {more} cannot be read")?,
        }
    }
    let undecoded = recording.undecoded_depth();
    for text in recording.warnings.iter().chain(&undecoded).chain(&recording.missing_poses(0..frames)) {
        writeln!(out, "odd        {}", shown(&text.to_string()))?;
    }
    for text in duplicates(recording) {
        writeln!(out, "odd        {}", shown(&text))?;
    }
    for problem in damaged.iter().take(MAX_LISTED_DAMAGED) {
        writeln!(out, "odd        {}", shown(&problem.to_string()))?;
    }
    Ok(())
}

/// A description of a recording's depth.
fn depth(recording: &Recording, has_camera: bool) -> String {
    let size = |w: u32, h: u32| format!("yes, {w}x{h} px");
    match recording.registration() {
        None if recording.site().is_some() => "of the scan".to_owned(),
        None => "none".to_owned(),
        Some(DepthRegistration::SameView) => "yes".to_owned(),
        Some(DepthRegistration::Enlarged(w, h)) => format!("{}, enlarged to the frames", size(w, h)),
        Some(DepthRegistration::Unknown(w, h)) => format!("{}: another view than the frames", size(w, h)),
        Some(DepthRegistration::OtherCamera(w, h)) if !has_camera => {
            format!("{} by a camera of its own; the frames' camera is needed to see it from there", size(w, h))
        }
        Some(DepthRegistration::OtherCamera(w, h)) => {
            let frames = recording.frame_count();
            let read = |frame: usize| recording.frames(frame..frame + 1).ok()?.next()?.ok()?.depth;
            let maps: Vec<_> = [0, frames / 2, frames - 1].into_iter().filter_map(read).collect();
            let share = maps.iter().map(|map| unknown_fraction(map)).sum::<f64>() / maps.len().max(1) as f64;
            format!(
                "{} by a camera of its own; {} % of the frames' pixels have none",
                size(w, h),
                fixed(100.0 * share, 1)
            )
        }
    }
}

/// Messages about repeated pictures, poses and times.
fn duplicates(recording: &Recording) -> Vec<String> {
    // Each picture is decoded, which takes minutes for a long video.
    let bar = progress_of(
        false,
        recording.frame_count(),
        "looking for pictures that repeat: {wide_bar} {pos}/{len}, {eta} left",
    );
    let repeated = recording.repeats(|| bar.inc(1));
    bar.finish_and_clear();
    let Duplicates { pictures, moved, poses, times } = match repeated {
        Ok(repeated) => repeated,
        Err(error) => return vec![format!("repeated pictures could not be searched for: {error}")],
    };
    let summary = |frames: &[usize], what: &str| {
        let first = frames.first()?;
        let number = format!("{} of {}", frames.len(), count(recording.frame_count(), "frame"));
        Some(format!("{number} {what} (first: frame {first})"))
    };
    let moved = match moved.len() {
        0 => String::new(),
        n => format!(", {n} of them with another pose"),
    };
    let pictures = summary(&pictures, "repeat the picture before")
        .map(|text| format!("{text}{moved}; --skip-duplicates leaves them out"));
    let poses = summary(&poses, "have the pose of the frame before, and another picture");
    let times = summary(&times, "have the timestamp of the frame before");
    [pictures, poses, times].into_iter().flatten().collect()
}

fn one_frame(args: &Args, shot: Shot, frame: usize, out: &mut impl Write) -> Result<()> {
    let recording = &shot.recording;
    super::check_frame(frame, recording.frame_count())?;
    let metres_per_unit =
        args.metres_per_unit.or(shot.scene.metres_per_unit).or(recording.kind.is_metric().then_some(1.0));
    let unit = if metres_per_unit.is_some() { "m" } else { "units" };
    let shown = |p: DVec3| format!("{} {unit}", pick::triple(p));
    let pose = recording.pose_at_frame(frame);
    writeln!(out, "frame      {frame} at {} s", fixed(recording.timestamps_s[frame], 6))?;
    match &pose {
        Ok(pose) => {
            let p = pose.position_in_world_m();
            let forward = pose.world_from_camera_rotation() * DVec3::Z;
            writeln!(out, "camera at  {}, looks along {:.3} {:.3} {:.3}", shown(p), forward.x, forward.y, forward.z)?;
        }
        Err(reason) => writeln!(out, "no pose    {reason}")?,
    }
    let opacity = recording.opacity(frame);
    if opacity < 1.0 {
        writeln!(out, "opacity    {} of the evidence", fixed(opacity, 3))?;
    }
    if args.picks.is_empty() {
        return Ok(());
    }
    pose?;
    let query = PointQuery { picks: &args.picks, distance_m: args.distance, metres_per_unit };
    pick::print_points(&Picker::new(&shot, frame, args.plane, Shot::surface_at)?, &query, out)
}

/// Ranges of the frames' exposure times and film speeds, as far as they are known.
fn exposure_ranges(exposures: &[FrameExposure]) -> String {
    let range = |values: Vec<f64>, unit: &str| -> Option<String> {
        let low = values.iter().copied().reduce(f64::min)?;
        let high = values.iter().copied().reduce(f64::max)?;
        Some(if low == high {
            format!("{} {unit}", fixed(low, 2))
        } else {
            format!("{} to {} {unit}", fixed(low, 2), fixed(high, 2))
        })
    };
    let times = range(exposures.iter().filter_map(|e| Some(1e3 * e.reported_s()?)).collect(), "ms");
    let speeds = range(exposures.iter().filter_map(|e| e.photo.iso).collect(), "ISO");
    let all: Vec<String> = times.into_iter().chain(speeds).collect();
    if all.is_empty() { String::new() } else { format!(": {}", all.join(", ")) }
}
