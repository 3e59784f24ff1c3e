//! `locard photo`.

mod aim;
mod args;
mod dials;
mod shoot;

use std::path::PathBuf;

use anyhow::{Result, bail};

pub use args::Args;
use args::{Bracket, Focus};
use dials::{Asked, Dials};
use shoot::Shoot;

use super::outputs::Inputs;
use super::{progress_of, tell, warn};
use crate::camera::exposure::INDOORS_LX;
use crate::camera::metering::PictureLight;
use crate::camera::{Geometry, Opening};
use crate::depth::measured_from;
use crate::gpu::Gpu;
use crate::photo::{self, Framing};
use crate::profile::Rig;
use crate::recording::Recording;
use crate::shot::{Note, USUAL_ISO};
use crate::sink::photograph;

pub fn run(args: &Args) -> Result<()> {
    let mut shot = args.light.open(Some(args.scene.clone()))?;
    let index = args.light.frame;
    shot.check_poses(index..index + 1)?;
    shot.settings.seed = args.seed;
    args.which.apply(&mut shot.settings)?;
    let taken = shot.taken(index);
    let whole = shot.geometry_at(index)?;
    let whole = with_film(whole, &shot.rig, shot.recording.exposure.get(index).and_then(|e| e.photo.focal_length_m));
    if whole.is_round() {
        bail!("a photograph out of a 360° picture is not made: composite into the recording, and crop that");
    }

    // Everything that can be refused is refused before anything is drawn.
    let camera = shot.camera();
    camera.lens.opening(&whole)?;
    shot.settings.check(&camera, &whole)?;
    let focal_length_m = args.focal.map(|mm| 1e-3 * mm);
    let (given_m, checked_m) = match args.focus {
        Focus::Metres(distance_m) => (distance_m, focal_length_m),
        // What a lens sees depends on where it is focused, which is not known yet. A focus series continues to
        // infinity.
        Focus::Auto => (f64::INFINITY, focal_length_m.filter(|_| args.bracket == Some(Bracket::Focus))),
    };
    let aim = aim::aim(args, &shot.recording, &whole, &shot.scene)?;
    Framing::aimed(&whole, args.film, checked_m, given_m, args.width, aim)?;
    let lux = match (args.light.lux, taken.settings()) {
        (None, None) => None,
        _ => Some(shot.scene_light(index, args.light.lux)?.lux),
    };
    let mut limits = shot.limits(index, args.light.aperture);
    let sums = args.hand_held && args.which.leaves_on(photo::OF_MOTION);
    let recorded_s = if sums { recorded_s(&shot.recording, index) } else { f64::INFINITY };
    if let Some(time_s) = args.light.shutter.filter(|&time_s| time_s > recorded_s * 1.001) {
        bail!(
            "--shutter {time_s}: the recording does not go on so long around frame {index}; accepted there are up to \
             {recorded_s:.3} s, or a frame further from its ends"
        );
    }
    limits.longest_s = limits.longest_s.min(recorded_s);
    let mut dials = Dials::new(args, taken, lux.unwrap_or(INDOORS_LX), limits)?;
    let count = dials.series(args.bracket).len();
    let left_out = dials.left_out(args.bracket);
    let inputs = Inputs::of(&shot);
    for path in (1..=count).map(|n| path_of(args, &n.to_string())).chain(args.bracket.map(|_| path_of(args, "sheet"))) {
        photograph::check(&path, args.force)?;
        inputs.check_file(&path)?;
    }
    if lux.is_none() {
        let text =
            format!("nothing says how bright the scene is (EXIF, a profile or --lux): {INDOORS_LX} lx are taken");
        warn(args.quiet, &text);
    }
    if let Some(text) = left_out {
        warn(args.quiet, &text);
    }
    for text in shot.recording.warnings.iter().chain(&shot.scene.warnings) {
        warn(args.quiet, text);
    }

    let frame = shot.read(index)?;
    let depth = frame.depth.as_ref().filter(|_| shot.settings.depth.occlusion);
    let (track, offset_s) = (&shot.recording.track, shot.recording.time_offset_s);
    if let Some(Err(why)) = depth.map(|depth| measured_from(depth, &whole, track, offset_s)) {
        warn(args.quiet, &format!("nothing real hides objects: {why}"));
    }
    let unknown_speed = camera.exposure.iso.or(taken.iso).is_none();
    if unknown_speed && camera.noise.is_some() && (args.light.iso.is_some() || args.bracket == Some(Bracket::Iso)) {
        let text = format!(
            "nothing says at what speed this camera's noise was measured (camera.exposure.iso): ISO {USUAL_ISO} is taken"
        );
        warn(args.quiet, &text);
    }
    if camera.noise.is_none() {
        let text = "nothing says how noisy this camera is: the photograph has the recording's grain and no other; `locard \
                    calibrate noise` measures it from pictures of a scene at rest, with --moving from the recording itself";
        warn(args.quiet, text);
    }
    let acts_on_real = shot.settings.acts_on_real();
    let compositor = shot.compositor(Gpu::open()?);
    for text in compositor.warnings() {
        warn(args.quiet, &text);
    }
    let mean = PictureLight::of(&frame.pixels, &camera.response).mean;
    let mut shoot = Shoot { args, shot, whole, frame, mean, camera, compositor, aim, sums };
    dials.focus_distance_m = shoot.focus_distance_m(focal_length_m)?;
    if args.bracket == Some(Bracket::Focus) && dials.focus_distance_m.is_infinite() {
        bail!(
            "--bracket focus goes from half a distance to twice, and infinity is sharp here: give a distance, as in --focus 2"
        );
    }
    let mut sheet = Vec::new();
    let mut told = false;
    let series = dials.series(args.bracket);
    let framed = |asked: &Asked| {
        Framing::aimed(&shoot.whole, args.film, focal_length_m, asked.focus_distance_m, args.width, aim)
    };
    let framings = series.iter().map(framed).collect::<Result<Vec<_>, _>>()?;
    for (n, (asked, framing)) in series.iter().zip(framings).enumerate() {
        let opening = shoot.lens(asked).opening(&framing.geometry)?;
        let flat = shoot.frame.depth.is_none() && acts_on_real;
        if flat && !told && opening.is_some_and(|opening| blurs(&opening, &framing)) {
            let text = "virtual things alone are out of focus: the recording has no depth here, and its part stays as sharp \
                        as it was recorded";
            warn(args.quiet, text);
            told = true;
        }
        if let Some(text) = dials.misses(asked) {
            warn(args.quiet, &text);
        }
        let bar = progress_of(args.quiet, 100, "{msg} {wide_bar} {percent} %, {elapsed}");
        bar.set_message(format!("photograph {} of {}", n + 1, series.len()));
        let done = |share: f64| bar.set_position((100.0 * share) as u64);
        let photo::Taken { pixels, shows_objects } = shoot.take(&dials, asked, &framing, opening, done)?;
        bar.finish_and_clear();
        if !shows_objects && n == 0 {
            warn(args.quiet, &Note::NothingSeen.to_string());
        }
        let path = path_of(args, &(n + 1).to_string());
        let notes = shoot.notes(&dials, asked, &framing);
        photograph::write(&path, &pixels, Some(&notes), args.force)?;
        tell(args.quiet, &format!("{}: {}", path.display(), label(asked, &framing).replace('\n', ", ")));
        if args.bracket.is_some() {
            sheet.extend(photo::small(&pixels).map(|small| (small, label(asked, &framing))));
        }
    }
    if args.bracket.is_some() {
        let path = path_of(args, "sheet");
        photograph::write(&path, &photo::contact_sheet(&sheet), None, args.force)?;
        tell(args.quiet, &format!("{}", path.display()));
    }
    Ok(())
}

/// How long a shutter centred on a frame's time can be open and still see frames, in seconds: at least one interval,
/// and unlimited if the frames' times mean nothing.
fn recorded_s(recording: &Recording, frame: usize) -> f64 {
    let times = &recording.timestamps_s;
    let (Some(first), Some(at), Some(last)) = (times.first(), times.get(frame), times.last()) else { return 0.0 };
    let interval_s = recording.frame_interval_s;
    if recording.kind.has_times() { interval_s + 2.0 * (at - first).min(last - at) } else { f64::INFINITY }
}

/// The camera's geometry. If nothing else gives the film's width, it is set so that the focal length is the one in the
/// frame's file.
fn with_film(whole: Geometry, rig: &Rig, focal_length_m: Option<f64>) -> Geometry {
    let Some(focal_length_m) = focal_length_m.filter(|_| !rig.gives_film_width()) else { return whole };
    let Geometry { mut intrinsics, distortion, .. } = whole;
    intrinsics.film_width_mm = 1e3 * focal_length_m * f64::from(intrinsics.width_px) / intrinsics.fx_px;
    Geometry::new(intrinsics, distortion)
}

/// For a single photograph the given name; in a series, the name with a hyphen and a part appended.
fn path_of(args: &Args, part: &str) -> PathBuf {
    if args.bracket.is_none() {
        return args.output.clone();
    }
    let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, extension) = (text(args.output.file_stem()), text(args.output.extension()));
    args.output.with_file_name(format!("{stem}-{part}.{extension}"))
}

fn label(asked: &Asked, framing: &Framing) -> String {
    let off =
        if asked.over_ev.abs() > 1.0 / 6.0 + 1e-6 { format!(", {:+.1} EV", asked.over_ev) } else { String::new() };
    let lens = format!("{:.1} mm", 1e3 * framing.focal_length_m);
    let focus = match framing.focus_distance_m {
        far if far.is_infinite() => "infinity".to_owned(),
        near => format!("{near:.2} m"),
    };
    format!("{}\n{lens} at {focus}{off}", asked.settings)
}

/// Whether objects at half the focus distance or at infinity would be visibly blurred.
fn blurs(opening: &Opening, framing: &Framing) -> bool {
    let fx_px = framing.geometry.intrinsics.fx_px;
    let nearer = if framing.focus_distance_m.is_finite() { 0.5 * framing.focus_distance_m } else { 1.0 };
    [nearer, f64::INFINITY].into_iter().any(|distance_m| opening.circle_px(fx_px, distance_m).abs() > 1.5)
}
