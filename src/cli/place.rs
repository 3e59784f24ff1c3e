//! `locard place`: places an object at a pixel, the same as a click in the window.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::DVec3;

use super::analysis::AnalysisArgs;
use super::pick::{Pick, Picker, PointSource, plane};
use super::warn;
use locard_engine::export::Inputs;
use locard_engine::recording::{OpenOptions, Recording};
use locard_engine::scene::document::Up;
use locard_engine::scene::{self, Document, Heading, MIN_SUPPORT_COSINE, Posture, SceneFile};
use locard_engine::shot::{Shot, ShotOptions};
use locard_engine::sink::{self, atomic::write_atomically};
use locard_engine::text::{fixed, number, shown};

#[derive(clap::Args)]
pub struct Args {
    /// The recording
    recording: PathBuf,
    /// The frame that shows the place
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = super::frame_number)]
    frame: usize,
    /// The place: column and row from the upper left. Without depth, also the same point in other
    /// frames
    #[arg(long, value_name = "X,Y[+N:X,Y]", value_parser = Pick::parse, allow_hyphen_values = true)]
    at: Pick,
    /// The evidence, a .glb or .gltf file
    #[arg(long)]
    model: PathBuf,
    /// The scene file to add it to; created if it does not exist
    #[arg(long)]
    scene: PathBuf,
    /// Rotation, counter-clockwise seen from above; by default its front faces the camera
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    heading: Option<f64>,
    /// Its flattest side lies on the surface
    #[arg(long, conflicts_with = "upright")]
    flat: bool,
    /// It stands upright, whatever the surface's slope (the default)
    #[arg(long)]
    upright: bool,
    /// Its largest extent, of a model that is not in metres
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    size: Option<f64>,
    /// Its name; by default its file's name
    #[arg(long)]
    name: Option<String>,
    /// Without depth: the plane a·x + b·y + c·z = d of the world that it stands on
    #[arg(long, value_name = "A,B,C,D", value_parser = plane, allow_hyphen_values = true)]
    plane: Option<[f64; 4]>,
    /// The camera, if the recording lacks it
    #[arg(long)]
    profile: Option<PathBuf>,
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    metres_per_unit: f64,
    #[command(flatten)]
    analysis: AnalysisArgs,
}

pub fn run(args: &Args) -> Result<()> {
    check_arguments(args)?;
    let options = OpenOptions { metres_per_unit: args.metres_per_unit, ..OpenOptions::default() };
    // A scene file may define the length of the recording's unit.
    let scene = args.scene.exists().then(|| args.scene.clone());
    let analysis = args.analysis.choice();
    let shot_options = ShotOptions { profile: args.profile.clone(), scene, analysis, ..ShotOptions::default() };
    let recording = Recording::open(&args.recording, &options)?;
    let (mut shot, ()) = args.analysis.open(recording, &shot_options, false, |_| Ok(()))?;
    // These would change the camera or the light.
    for note in shot.unused_analysis_note().into_iter().chain(shot.stale_estimates()) {
        warn(false, &note.to_string());
    }
    if !args.scene.exists() {
        Inputs::of(&shot).check_file(&args.scene)?;
        sink::check_file(&args.scene, false)?;
    }
    let mut document = if args.scene.exists() {
        scene::document::read(&args.scene)?
    } else {
        Document::new(SceneFile::default()).context("a new scene")?
    };
    let picked = Picker::new(&shot, args.frame, args.plane, Shot::placement_surface)?.find(&args.at)?;
    let mut file = document.value().clone();
    let file_up = file.up;
    // Without objects in the scene, whose orientation would change.
    let is_guessed = file.up.is_none() && shot.recording.up.is_none() && file.objects.is_empty();
    let up = match file.up {
        Some(up) => up.axis(&args.scene, "up")?,
        None if is_guessed => shot.up_on(picked.normal()),
        None => shot.recording.up.unwrap_or(DVec3::Z),
    };
    if is_guessed {
        file.up = Some(Up::Direction(up.to_array()));
    }
    let support = picked.support(up);
    let model = scene::relative(&args.model, &args.scene);
    let posture = if args.flat { Posture::Flat } else { Posture::Upright };
    let facing = || shot.heading_to_camera(args.frame, support.point_m, up, 0.0);
    let heading = args.heading.map_or_else(facing, Heading::Deg);
    let joined = args.scene.parent().unwrap_or(Path::new("")).join(&model);
    let mut placed = scene::place_at_rest(&model, &args.scene, &support, posture, heading, up, args.size)
        .map_err(|error| error.with_path(&joined, &args.model))?;
    placed.name.clone_from(&args.name);
    let position = placed.position_m.unwrap_or_default();
    if file.gauge.is_none() {
        file.gauge = shot.gauge(args.frame);
    }
    file.objects.push(placed);
    // A scene that fails to load is not written.
    shot.set_scene(Arc::new(scene::load_file(&file, &args.scene, shot.recording.up)?));
    document.set(file).context("the scene file")?;
    write_atomically(&args.scene, true, |out| out.write_all(document.to_string().as_bytes()))?;

    let mut out = std::io::stdout().lock();
    writeln!(out, "placed     {} at {} m", shown(&model), position.map(|n| fixed(n, 4)).join(" "))?;
    // Sides along the model's own axes.
    if let Some(corners_m) = shot.scene.objects.last().and_then(|object| object.corners_m(&shot.scene)) {
        let sides = [1, 2, 4].map(|axis| fixed(corners_m[0].distance(corners_m[axis]), 3));
        writeln!(out, "size       {} m", sides.join(" × "))?;
    }
    print_surface(&mut out, &picked.source, support.tilt_deg(up))?;
    if support.normal.dot(up) < MIN_SUPPORT_COSINE && !args.flat {
        writeln!(
            out,
            "odd        the surface is steep: the model stands upright, its foot at the picked height, in the air if no floor is there; --flat lays it against a wall"
        )?;
    }
    if is_guessed {
        let up = up.to_array().map(|n| fixed(n, 4)).join(", ");
        let by = "from the surface's normal, or from the cameras' up if that leans far";
        writeln!(out, "odd        up is unknown: [{up}] is assumed, {by}, and written as `up` into the scene file")?;
    } else if file_up.is_none() && shot.recording.up.is_none() {
        writeln!(out, "odd        up is unknown: z is assumed; `up` in the scene file overrides it")?;
    }
    print_issues(&mut out, &mut shot, args.frame)
}

fn check_arguments(args: &Args) -> Result<()> {
    if let Some(odd) = args.heading.filter(|heading| !(-360.0..=360.0).contains(heading)) {
        bail!("--heading {}: expected -360 to 360 degrees", number(odd));
    }
    if let Some(odd) = args.size.filter(|size| !(1e-4..=1e3).contains(size)) {
        bail!("--size {}: expected 0.0001 to 1000 metres", number(odd));
    }
    if args.name.as_deref().is_some_and(|name| name.trim().is_empty()) {
        bail!("--name: the name is empty; omit it to use the name of the model's file");
    }
    let ending = args.scene.extension().unwrap_or_default().to_ascii_lowercase();
    if ending != "toml" {
        bail!("--scene {}: the name of a scene file ends in .toml", args.scene.display());
    }
    if args.model.to_str().is_none() && args.model.exists() {
        bail!(
            "--model {}: a scene file cannot hold this name, which is not UTF-8; rename the file",
            args.model.display()
        );
    }
    Ok(())
}

/// Prints how well the surface is known.
fn print_surface(out: &mut impl Write, source: &PointSource, tilt_deg: f64) -> Result<()> {
    match source {
        PointSource::Depth(estimate) => writeln!(
            out,
            "surface    tilted by {tilt_deg:.1}°, depth {:.4} m, uneven by {:.1} mm, {:.0} % of the surroundings",
            estimate.depth_m,
            1e3 * estimate.sigma_m,
            100.0 * estimate.share
        )?,
        PointSource::Plane { .. } => writeln!(out, "surface    tilted by {tilt_deg:.1}°, as given")?,
        PointSource::Views(estimate) => writeln!(
            out,
            "surface    taken for level; the point is known within {:.1} mm (rays at {:.1}°, {:.1} px off)",
            1e3 * estimate.sigma_m,
            estimate.angle_deg,
            estimate.rms_px
        )?,
    }
    Ok(())
}

/// Prints warnings about the last object in a frame.
fn print_issues(out: &mut impl Write, shot: &mut Shot, frame: usize) -> Result<()> {
    let frame = shot.read(frame)?;
    let placed = shot.scene.objects.len() - 1;
    for issue in shot.object_issues(&frame).iter().filter(|issue| issue.objects.contains(&placed)) {
        writeln!(out, "odd        {}", shown(&issue.note.to_string()))?;
    }
    if let Some(note) = shot.far_from_light() {
        writeln!(out, "odd        {}", shown(&note.to_string()))?;
    }
    Ok(())
}
