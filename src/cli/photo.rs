//! `locard photo`.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail};

use super::light::{self, Known, Opened, USUAL_ISO};
use super::outputs::Inputs;
use super::which::Which;
use super::{Interruption, tell, warn};
use crate::camera::exposure::{INDOORS_LX, Settings};
use crate::camera::metering::{Limits, Mode, PictureLight, meter};
use crate::camera::stops::{self, Step};
use crate::camera::{Film, Geometry, Lens, Opening};
use crate::compositor::{Compositor, Job, measured_from};
use crate::frame::Frame;
use crate::gpu::Gpu;
use crate::image::{Pixels, Rect};
use crate::photo::{self, Exposed, Framing, Real, Site, Summed};
use crate::profile::Rig;
use crate::recording::Recording;
use crate::sink::photograph::{self, Notes};
use crate::words::short;

/// Timestamps from here on (2001-09-09) are seconds since 1970.
const EPOCH_S: f64 = 1e9;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    site: light::Site,
    /// A .glb or .gltf in the recording's world coordinates, or a scene.toml
    #[arg(long)]
    scene: PathBuf,
    /// p (program), a (aperture priority), s (shutter priority), m (manual); else by what is set
    #[arg(long)]
    mode: Option<Mode>,
    /// The focal length in mm; else one that sees all of the recorded picture that the film's shape allows
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = focal_length)]
    focal: Option<f64>,
    /// What is sharp: a distance in metres, inf, or auto (what is in the middle)
    #[arg(long, default_value = "auto", allow_hyphen_values = true, value_parser = focus)]
    focus: Focus,
    /// The film: 36x24, aps-c, aps-c-canon, micro-4/3, 1in, 1/2.3in, 6x6 or WIDTHxHEIGHT in mm; else the recording's
    #[arg(long)]
    film: Option<Film>,
    /// Width of the photograph; else as many pixels as the recording has there
    #[arg(long, value_name = "PX")]
    width: Option<u32>,
    /// A series in which one setting goes through its range, and a contact sheet
    #[arg(long, value_enum)]
    bracket: Option<Bracket>,
    #[command(flatten)]
    which: Which,
    /// Seed of the grain
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// A .jpg or .png; of a series, NAME-1.jpg and so on, and NAME-sheet.jpg
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    output: PathBuf,
    /// Replace pictures that exist
    #[arg(long)]
    force: bool,
    /// No warnings
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Focus {
    Auto,
    Metres(f64),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Bracket {
    /// f/2.8 to f/22
    Aperture,
    /// Three stops to both sides
    Shutter,
    /// ISO 100 to 25600
    Iso,
    /// From half the distance to twice
    Focus,
}

fn focus(text: &str) -> Result<Focus, String> {
    let metres = match text.trim().trim_end_matches('m').trim_end() {
        "auto" => return Ok(Focus::Auto),
        "inf" | "infinity" => Some(f64::INFINITY),
        number => number.parse().ok().filter(|m: &f64| (0.01..=1e5).contains(m)),
    };
    metres.map(Focus::Metres).ok_or_else(|| format!("{text} is refused: accepted are auto, inf, and 0.01 to 100000 m"))
}

fn focal_length(text: &str) -> Result<f64, String> {
    let mm = text.trim().trim_end_matches("mm").trim_end().parse().ok().filter(|mm| (1.0..=5000.0).contains(mm));
    mm.ok_or_else(|| format!("{text} is refused: accepted is 1 to 5000 mm"))
}

/// One photograph of a series.
struct Asked {
    settings: Settings,
    /// Stops brighter than wanted that nothing was left to choose against.
    over_ev: f64,
    focus_distance_m: f64,
}

/// What the person set, in a mode.
struct Dials {
    mode: Mode,
    set: Settings,
    lux: f64,
    compensation_ev: f64,
    limits: Limits,
    focus_distance_m: f64,
}

/// The times of a series, stops from its middle.
const TIMES: std::ops::RangeInclusive<i32> = -3..=3;

impl Dials {
    fn new(args: &Args, taken: Known, lux: f64, limits: Limits) -> Result<Self> {
        let by_settings = match (args.site.aperture, args.site.shutter) {
            (Some(_), Some(_)) => Mode::Manual,
            (Some(_), None) => Mode::AperturePriority,
            (None, Some(_)) => Mode::ShutterPriority,
            (None, None) => Mode::Program,
        };
        let mode = args.mode.unwrap_or(by_settings);
        let chooses = |name: &str, given: Option<f64>, modes: [Mode; 2], other: &str| match given {
            Some(_) if modes.contains(&mode) => {
                bail!(
                    "--mode {} chooses the {name} itself: leave --{name} out, or take --mode {other} or m",
                    mode.letter()
                )
            }
            _ => Ok(()),
        };
        chooses("aperture", args.site.aperture, [Mode::Program, Mode::ShutterPriority], "a")?;
        chooses("shutter", args.site.shutter, [Mode::Program, Mode::AperturePriority], "s")?;
        let needs = |given: Option<f64>, modes: [Mode; 2], name: &str| {
            if modes.contains(&mode) && given.is_none() {
                bail!("--mode {} needs --{name}", mode.letter());
            }
            Ok(given.unwrap_or(1.0))
        };
        // A bracket goes through what it varies.
        let varied = |what: Bracket, given: Option<f64>, usual: f64| match args.bracket {
            Some(bracket) if bracket == what => given.or(Some(usual)),
            _ => given,
        };
        let f_number = varied(Bracket::Aperture, args.site.aperture, 8f64.sqrt());
        let time_s = varied(Bracket::Shutter, args.site.shutter, limits.hand_held_s);
        let set = Settings {
            f_number: needs(f_number, [Mode::AperturePriority, Mode::Manual], "aperture")?,
            time_s: needs(time_s, [Mode::ShutterPriority, Mode::Manual], "shutter")?,
            iso: args.site.iso.or(taken.iso).unwrap_or(USUAL_ISO),
        };
        Ok(Self {
            mode,
            set: set.exact(),
            lux,
            compensation_ev: args.site.compensation,
            limits,
            focus_distance_m: f64::INFINITY,
        })
    }

    fn metered(&self, mode: Mode, set: Settings) -> Asked {
        let metered = meter(mode, self.lux, set, self.compensation_ev, &self.limits);
        Asked { settings: metered.settings, over_ev: metered.over_ev, focus_distance_m: self.focus_distance_m }
    }

    /// Of an exposure that its mode could not bring about, why.
    fn misses(&self, asked: &Asked) -> Option<String> {
        let missed = self.mode != Mode::Manual && asked.over_ev.abs() > 0.5;
        missed.then(|| {
            let (stops, side, other) = match asked.over_ev {
                over if over > 0.0 => (over, "too bright", "a smaller"),
                over => (-over, "too dark", "a larger"),
            };
            let Limits { shortest_s, longest_s, widest_f_number, narrowest_f_number, .. } = self.limits;
            format!(
                "{} is {stops:.1} stops {side}: the shutter can be open from {} to {} (no longer than frames go on around \
                 this one), the aperture {} to {}; {other} --iso helps, or a frame further from the recording's ends",
                asked.settings,
                stops::format_shutter_s(shortest_s),
                stops::format_shutter_s(longest_s),
                stops::format_f_number(widest_f_number),
                stops::format_f_number(narrowest_f_number),
            )
        })
    }

    /// What is varied stays as it is set; in manual mode all the rest does too, else the camera makes up for it.
    fn series(&self, bracket: Option<Bracket>) -> Vec<Asked> {
        let manual = self.mode == Mode::Manual;
        let usual = self.metered(self.mode, self.set);
        let Some(bracket) = bracket else { return vec![usual] };
        let Limits { widest_f_number, narrowest_f_number, shortest_s, longest_s, .. } = self.limits;
        let full = |value: f64, least: f64, most: f64| (least * 0.999..=most * 1.001).contains(&value);
        match bracket {
            Bracket::Aperture => {
                let mode = if manual { Mode::Manual } else { Mode::AperturePriority };
                let stops = stops::f_numbers(Step::Full).into_iter().map(|stop| stop.exact);
                let stops = stops.filter(|n| full(*n, widest_f_number, narrowest_f_number));
                stops.map(|f_number| self.metered(mode, Settings { f_number, ..self.set })).collect()
            }
            Bracket::Shutter => {
                let mode = if manual { Mode::Manual } else { Mode::ShutterPriority };
                let middle = if manual { self.set.time_s } else { usual.settings.time_s };
                let times = TIMES.map(|stops| middle * f64::from(stops).exp2());
                let times = times.filter(|t| full(*t, shortest_s, longest_s));
                times.map(|time_s| self.metered(mode, Settings { time_s, ..self.set })).collect()
            }
            Bracket::Iso => {
                let speeds = stops::iso_speeds(Step::Full).into_iter().map(|stop| stop.exact);
                speeds.map(|iso| self.metered(self.mode, Settings { iso, ..self.set })).collect()
            }
            Bracket::Focus => (-3..=3)
                .map(|thirds| {
                    let focus_distance_m = self.focus_distance_m * (f64::from(thirds) / 3.0).exp2();
                    Asked { focus_distance_m, settings: usual.settings, over_ev: usual.over_ev }
                })
                .collect(),
        }
    }
}

/// A recording, opened, with the frame that is photographed.
struct Shoot<'a> {
    args: &'a Args,
    recording: Recording,
    rig: Rig,
    whole: Geometry,
    frame: Frame,
    /// Of its linear light.
    mean: f64,
    compositor: Compositor,
}

pub fn run(args: &Args, interruption: &Interruption) -> Result<()> {
    let Opened { recording, rig, mut effects, taken } = args.site.open()?;
    let index = args.site.frame;
    recording.pose_at_frame(index).with_context(|| format!("frame {index} has no pose"))?;
    effects.seed = args.seed;
    args.which.apply(&mut effects)?;
    let whole = super::composite::camera_of(&recording, &rig, index)?;
    let whole = with_film(whole, &rig, recording.exposure.get(index).and_then(|e| e.photo.focal_length_m));
    if whole.is_round() {
        bail!("a photograph out of a 360° picture is not made: composite into the recording, and crop that");
    }

    // All that can be refused is, before anything is drawn.
    let focal_length_m = args.focal.map(|mm| 1e-3 * mm);
    let (given_m, checked_m) = match args.focus {
        Focus::Metres(distance_m) => (distance_m, focal_length_m),
        // What a lens sees depends on where it is focused, which is not known yet; a series goes on to infinity.
        Focus::Auto => (f64::INFINITY, focal_length_m.filter(|_| args.bracket == Some(Bracket::Focus))),
    };
    Framing::new(&whole, args.film, checked_m, given_m, args.width)?;
    let scene = crate::scene::load(&args.scene, recording.up)?;
    for text in recording.warnings.iter().chain(&scene.warnings) {
        warn(args.quiet, text);
    }
    let lux = match (args.site.lux, taken.settings()) {
        (None, None) => {
            let text =
                format!("nothing says how bright the scene is (EXIF, a profile or --lux): {INDOORS_LX} lx are taken");
            warn(args.quiet, &text);
            INDOORS_LX
        }
        _ => light::scene_light(args.site.lux, &recording, index, &rig, taken)?.lux,
    };
    effects.check(&rig.camera(), &whole)?;
    let asked = Known { f_number: args.site.aperture, ..Known::default() };
    let mut limits = light::limits(&rig, asked);
    let recorded_s = recorded_s(&recording, index);
    if let Some(time_s) = args.site.shutter.filter(|&time_s| time_s > recorded_s * 1.001) {
        bail!(
            "--shutter {time_s}: the recording does not go on so long around frame {index}; accepted there are up to \
             {recorded_s:.3} s, or a frame further from its ends"
        );
    }
    limits.longest_s = limits.longest_s.min(recorded_s);
    let mut dials = Dials::new(args, taken, lux, limits)?;
    let count = dials.series(args.bracket).len();
    if let (Some(Bracket::Shutter), left_out @ 1..) = (args.bracket, TIMES.count().saturating_sub(count)) {
        let Limits { shortest_s, longest_s, .. } = dials.limits;
        let text = format!(
            "{left_out} of {} times are left out: shutters here are open from {} to {}",
            TIMES.count(),
            stops::format_shutter_s(shortest_s),
            stops::format_shutter_s(longest_s)
        );
        warn(args.quiet, &text);
    }
    let inputs = Inputs::of(&recording).and(&recording.camera_profile).and(&args.site.profile).and(&scene.files);
    for path in (1..=count).map(|n| path_of(args, &n.to_string())).chain(args.bracket.map(|_| path_of(args, "sheet"))) {
        photograph::check(&path, args.force)?;
        inputs.check_file(&path)?;
    }

    let frame = recording.frames(index..index + 1)?.next().context("the frame cannot be read")??;
    let camera = rig.camera();
    let depth = frame.depth.as_ref().filter(|_| effects.depth.occlusion);
    if let Some(Err(why)) = depth.map(|depth| measured_from(depth, &whole, &recording.track, recording.time_offset_s)) {
        warn(args.quiet, &format!("nothing real hides objects: {why}"));
    }
    let unknown_speed = rig.exposure.iso.or(taken.iso).is_none();
    if unknown_speed && camera.noise.is_some() && (args.site.iso.is_some() || args.bracket == Some(Bracket::Iso)) {
        let text = format!(
            "nothing says at what speed this camera's noise was measured (camera.exposure.iso): ISO {USUAL_ISO} is taken"
        );
        warn(args.quiet, &text);
    }
    if camera.noise.is_none() {
        let text = "nothing says how noisy this camera is: the photograph has the recording's grain and no other; `locard \
                    calibrate noise` measures it from pictures of a scene at rest";
        warn(args.quiet, text);
    }
    let compositor = Compositor::new(Gpu::open()?, camera, effects, scene);
    for text in compositor.warnings() {
        warn(args.quiet, &text);
    }
    let mean = PictureLight::of(&frame.pixels, &rig.response).mean;
    let mut site = Shoot { args, recording, rig, whole, frame, mean, compositor };
    dials.focus_distance_m = site.focus_distance_m(focal_length_m)?;
    let mut sheet = Vec::new();
    let mut told = false;
    let series = dials.series(args.bracket);
    let framed =
        |asked: &Asked| Framing::new(&site.whole, args.film, focal_length_m, asked.focus_distance_m, args.width);
    let framings = series.iter().map(framed).collect::<Result<Vec<_>, _>>()?;
    for (n, (asked, framing)) in series.iter().zip(framings).enumerate() {
        let opening = site.lens(asked).opening(&framing.geometry)?;
        let flat = site.frame.depth.is_none();
        if flat && !told && opening.is_some_and(|opening| blurs(&opening, &framing)) {
            let text = "virtual things alone are out of focus: the recording has no depth here, and its part stays as sharp \
                        as it was recorded";
            warn(args.quiet, text);
            told = true;
        }
        if let Some(text) = dials.misses(asked) {
            warn(args.quiet, &text);
        }
        let pixels = site.take(&dials, asked, &framing, opening, taken)?;
        let path = path_of(args, &(n + 1).to_string());
        let notes = site.notes(&dials, asked, &framing);
        interruption.hold(|| Ok(photograph::write(&path, &pixels, Some(&notes), args.force)?))?;
        tell(args.quiet, &format!("{}: {}", path.display(), label(asked, &framing).replace('\n', ", ")));
        if args.bracket.is_some() {
            sheet.extend(photo::small(&pixels).map(|small| (small, label(asked, &framing))));
        }
    }
    if args.bracket.is_some() {
        let path = path_of(args, "sheet");
        interruption.hold(|| Ok(photograph::write(&path, &photo::contact_sheet(&sheet), None, args.force)?))?;
        tell(args.quiet, &format!("{}", path.display()));
    }
    Ok(())
}

/// How long a shutter whose middle is a frame's time can be open and see frames all the while, seconds; an interval at
/// least, and any time where the frames' own mean nothing.
fn recorded_s(recording: &Recording, frame: usize) -> f64 {
    let times = &recording.timestamps_s;
    let (Some(first), Some(at), Some(last)) = (times.first(), times.get(frame), times.last()) else { return 0.0 };
    let interval_s = recording.frame_interval_s;
    if recording.kind.has_times() { interval_s + 2.0 * (at - first).min(last - at) } else { f64::INFINITY }
}

/// The camera's geometry with the width of film at which its focal length is what the frame's file says, where nothing else
/// tells how wide the film is.
fn with_film(whole: Geometry, rig: &Rig, focal_length_m: Option<f64>) -> Geometry {
    let Some(focal_length_m) = focal_length_m.filter(|_| !rig.gives_film_width()) else { return whole };
    let Geometry { mut intrinsics, distortion, .. } = whole;
    intrinsics.film_width_mm = 1e3 * focal_length_m * f64::from(intrinsics.width_px) / intrinsics.fx_px;
    Geometry::new(intrinsics, distortion)
}

/// Of a single photograph the name that was given, of a series one with a part behind a hyphen.
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

/// Whether things at half the distance that is sharp, or behind it at infinity, would show that they are not.
fn blurs(opening: &Opening, framing: &Framing) -> bool {
    let fx_px = framing.geometry.intrinsics.fx_px;
    let nearer = if framing.focus_distance_m.is_finite() { 0.5 * framing.focus_distance_m } else { 1.0 };
    [nearer, f64::INFINITY].into_iter().any(|distance_m| opening.circle_px(fx_px, distance_m).abs() > 1.5)
}

impl Shoot<'_> {
    fn focus_distance_m(&mut self, focal_length_m: Option<f64>) -> Result<f64> {
        if let Focus::Metres(distance_m) = self.args.focus {
            return Ok(distance_m);
        }
        let pending = self.compositor.submit(Job {
            frame: self.frame.clone(),
            geometry: &self.whole,
            track: &self.recording.track,
            time_offset_s: self.recording.time_offset_s,
            interval_s: self.recording.frame_interval_s,
            want_layer: true,
            photograph: None,
        })?;
        let layer = self.compositor.collect(pending)?.layer.unwrap_or_default();
        let framed = |f| Framing::new(&self.whole, self.args.film, f, f64::INFINITY, self.args.width);
        // A lens that sees too much at infinity may see enough where it will be focused.
        let framing = framed(focal_length_m).or_else(|_| framed(None))?;
        let (width, height) = framing.size();
        let corner = framing.framed.source_px(glam::DVec2::new(f64::from(width), f64::from(height)));
        let seen = Rect::new(
            framing.framed.left_px as i32,
            framing.framed.top_px as i32,
            corner.x.round() as i32,
            corner.y.round() as i32,
        );
        let found = photo::distance_m(&layer, self.frame.depth.as_ref(), seen);
        if found.is_none() {
            warn(self.args.quiet, "there is nothing to focus on: infinity is sharp; --focus sets a distance");
        }
        Ok(found.unwrap_or(f64::INFINITY))
    }

    fn lens(&self, asked: &Asked) -> Lens {
        Lens {
            f_number: Some(asked.settings.f_number),
            aperture_diameter_mm: None,
            focus_distance_m: Some(asked.focus_distance_m).filter(|d| d.is_finite()),
            ..self.rig.lens.clone()
        }
    }

    fn take(
        &mut self,
        dials: &Dials,
        asked: &Asked,
        framing: &Framing,
        opening: Option<Opening>,
        taken: Known,
    ) -> Result<Pixels> {
        let (args, recording) = (self.args, &self.recording);
        let has_times = recording.kind.has_times();
        let (range, weights) = if has_times {
            let (times, interval_s) = (&recording.timestamps_s, recording.frame_interval_s);
            photo::shutter_weights(times, interval_s, args.site.frame, asked.settings.time_s)
        } else {
            (args.site.frame..args.site.frame + 1, vec![1.0])
        };
        let mut frames = Vec::with_capacity(weights.len());
        let mut summed = Vec::new();
        if range.len() == 1 {
            frames.push((1.0, self.frame.pixels.clone()));
        } else {
            for (frame, weight) in recording.frames(range)?.zip(weights) {
                let frame = frame?;
                let exposure_s = self.compositor.exposure_time_s(&frame, recording.frame_interval_s);
                summed.push(Summed { time_s: frame.timestamp_s - self.frame.timestamp_s, exposure_s, weight });
                frames.push((weight, frame.pixels));
            }
        }
        let response = &self.rig.response;
        // By the frame itself: what it shows is what was metered.
        let gain = if self.mean > 0.0 { asked.settings.mean_light(dials.lux) / self.mean } else { 1.0 };
        // The recording's own settings leave its light as it is, whatever roundings say.
        let gain = if (gain - 1.0).abs() < 1e-9 { 1.0 } else { gain };
        let real = Real::new(&frames, response, &framing.framed, framing.size(), gain);
        drop(frames);
        let measured_at = self.rig.exposure.iso.or(taken.iso).unwrap_or(USUAL_ISO);
        let exposed = Exposed {
            opening,
            time_s: if has_times { asked.settings.time_s } else { 0.0 },
            over_ev: gain.log2(),
            iso_ratio: asked.settings.iso / measured_at,
        };
        let site = Site {
            recorded: &self.whole,
            track: &recording.track,
            time_offset_s: recording.time_offset_s,
            interval_s: recording.frame_interval_s,
            frame: args.site.frame,
            timestamp_s: self.frame.timestamp_s,
            exposure: self.frame.exposure,
            summed: &summed,
            depth: self.frame.depth.as_ref(),
        };
        Ok(photo::take(&mut self.compositor, &site, framing, real, &exposed)?)
    }

    fn notes(&self, dials: &Dials, asked: &Asked, framing: &Framing) -> Notes {
        let Settings { f_number, time_s, iso } = asked.settings;
        let focal_length_mm = 1e3 * framing.focal_length_m;
        let clock_s = Some(self.frame.timestamp_s).filter(|t| *t >= EPOCH_S);
        let recorded_s = self.frame.exposure.photo.taken_s.or(clock_s);
        let now_s = || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Notes {
            // As they are engraved, like a camera writes them.
            f_number: stops::marked(&stops::f_numbers(Step::Third), f_number),
            time_s: stops::marked(&stops::shutter_times_s(Step::Third), time_s),
            iso: stops::marked(&stops::iso_speeds(Step::Third), iso),
            focal_length_mm,
            equivalent_mm: framing.film.equivalent_35mm(focal_length_mm),
            focus_distance_m: asked.focus_distance_m,
            compensation_ev: dials.compensation_ev,
            program: match dials.mode {
                Mode::Manual => 1,
                Mode::Program => 2,
                Mode::AperturePriority => 3,
                Mode::ShutterPriority => 4,
            },
            taken_s: recorded_s.unwrap_or_else(now_s),
            description: format!(
                "frame {} of {} at {} s",
                self.args.site.frame,
                name(&self.recording.path),
                short(self.frame.timestamp_s)
            ),
        }
    }
}
