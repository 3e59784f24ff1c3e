//! A camera and its poses, as the command line asks for them.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Result;

use super::{ending, say, warn};
use crate::compositor::Settings;
use crate::live::{PoseSource, open_poses};
use crate::pixels::Pixels;
use crate::pose::Pose;
use crate::profile::Rig;
use crate::source::video::{ColorMatrix, ColorRange};
use crate::webcam::{self, Camera, Layout, Newest, Picture, Taken, Wanted};
use crate::words::{count, fixed, shown};

#[derive(clap::Args)]
pub struct CameraArgs {
    /// The camera: its number or device (`locard doctor` lists them), or a video that is played in its place
    #[arg(long, value_name = "N|VIDEO")]
    camera: String,
    /// Where poses come from: tags (printed by `locard board`), tags:BOARD.toml, opentrackio://HOST:PORT, freed://HOST:PORT, file:RECORDING (played again), or none
    #[arg(long, default_value = "none", value_name = "SOURCE")]
    pose: String,
    /// Size of the pictures, px; the profile's, else 640x480
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u32, u32)>,
    /// Pictures a second
    #[arg(long, default_value_t = 30.0, value_name = "HZ", value_parser = rate)]
    rate: f64,
    /// How the camera delivers them: rgb, yuyv, nv12 or mjpeg; without it, the best that comes at this size and rate
    #[arg(long, value_parser = layout)]
    format: Option<Layout>,
    /// The span of Y' that the camera uses, instead of what its driver says: limited (16 to 235) or full
    #[arg(long, value_parser = range)]
    range: Option<ColorRange>,
    /// The camera's colour matrix, instead of what its driver says: bt601, bt709 or bt2020
    #[arg(long, value_parser = matrix)]
    matrix: Option<ColorMatrix>,
    /// End after so many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// End after so many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// No messages but errors
    #[arg(long, short)]
    pub quiet: bool,
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (16..=16384).contains(side));
    let sides = text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
    sides.ok_or_else(|| format!("{text} is refused: accepted is WIDTHxHEIGHT, as in 640x480"))
}

fn rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate| (0.1..=1000.0).contains(rate));
    rate.ok_or_else(|| format!("{text} is refused: accepted is a number from 0.1 to 1000"))
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| *seconds > 0.0 && *seconds <= 1e6);
    seconds.ok_or_else(|| format!("{text} is refused: accepted is a number of seconds above 0"))
}

fn layout(text: &str) -> Result<Layout, String> {
    Layout::of_name(text)
        .ok_or_else(|| format!("{text} is refused: accepted are {}", Layout::PREFERRED.map(Layout::name).join(", ")))
}

fn range(text: &str) -> Result<ColorRange, String> {
    match text {
        "limited" => Ok(ColorRange::Limited),
        "full" => Ok(ColorRange::Full),
        _ => Err(format!("{text} is refused: accepted are limited, full")),
    }
}

fn matrix(text: &str) -> Result<ColorMatrix, String> {
    match text {
        "bt601" => Ok(ColorMatrix::Bt601),
        "bt709" => Ok(ColorMatrix::Bt709),
        "bt2020" => Ok(ColorMatrix::Bt2020),
        _ => Err(format!("{text} is refused: accepted are bt601, bt709, bt2020")),
    }
}

/// What came of a camera.
pub enum Next {
    Picture(Box<(Picture, Pixels)>),
    Nothing,
    Ended,
}

/// A camera that has agreed on what it gives, and where its poses come from.
pub struct Agreed {
    pub camera: Camera,
    pub poses: Box<dyn PoseSource>,
    /// From a picture to the next, seconds.
    pub interval_s: f64,
    frames: Option<u64>,
    seconds: Option<f64>,
    quiet: bool,
}

/// A camera that is watched until somebody ends it.
pub struct Watching {
    newest: Newest<Picture>,
    poses: Box<dyn PoseSource>,
    frames: Option<u64>,
    until: Option<Instant>,
    gone: Option<String>,
    /// Pictures that could not be decoded.
    damaged: u64,
    began: Instant,
    quiet: bool,
}

/// Poses that are known beforehand come so far ahead of their frames, seconds.
const AHEAD_S: f64 = 1.0;

/// The camera that a profile describes.
fn profiled(profile: &Path) -> Result<crate::camera::Camera> {
    let mut rig = Rig::default();
    rig.read(profile, &mut Settings::default())?;
    Ok(rig.camera())
}

impl Agreed {
    /// Opens the camera and its poses. `profile` names the camera's profile, if one is given.
    pub fn open(args: &CameraArgs, profile: Option<&Path>) -> Result<Self> {
        let profiled = profile.map(profiled).transpose()?;
        let poses = open_poses(&args.pose, profiled.as_ref())?;
        let geometry = profiled.as_ref().and_then(|camera| camera.geometry.as_ref());
        let profile_px = geometry.map(|geometry| (geometry.intrinsics.width_px, geometry.intrinsics.height_px));
        let usual = Wanted::default();
        let wanted = Wanted {
            size: args.size.or(profile_px).unwrap_or(usual.size),
            rate_hz: args.rate,
            layout: args.format,
            range: args.range,
            matrix: args.matrix,
        };
        let camera = webcam::open(&args.camera, &wanted)?;
        let given = &camera.given;
        let rate_hz = given.rate_hz.unwrap_or(args.rate);
        let hz = |rate: f64| fixed(rate, 2);
        let gives = format!("{} gives {} at {} Hz", shown(&given.name), given.delivered, hz(rate_hz));
        let as_asked = (given.delivered.width, given.delivered.height) == wanted.size
            && (rate_hz - wanted.rate_hz).abs() < 0.05
            && wanted.layout.is_none_or(|layout| layout == given.delivered.layout);
        let asked = format!(
            "{}x{} {}at {} Hz",
            wanted.size.0,
            wanted.size.1,
            wanted.layout.map_or(String::new(), |layout| format!("{layout} ")),
            hz(wanted.rate_hz)
        );
        warn(args.quiet, &if as_asked { gives } else { format!("{gives}; asked for was {asked}") });
        let (frames, seconds, quiet) = (args.frames, args.seconds, args.quiet);
        Ok(Self { camera, poses, interval_s: 1.0 / rate_hz, frames, seconds, quiet })
    }

    /// Starts the camera. From here on Ctrl-C ends what is written, and then the program.
    pub fn start(self) -> Result<Watching> {
        let newest = self.camera.start()?;
        ending::gently();
        let began = Instant::now();
        Ok(Watching {
            newest,
            poses: self.poses,
            frames: self.frames,
            until: self.seconds.map(|seconds| began + Duration::from_secs_f64(seconds)),
            gone: None,
            damaged: 0,
            began,
            quiet: self.quiet,
        })
    }
}

impl Watching {
    /// Whether nobody has ended it, and fewer frames or seconds have passed than were asked for.
    pub fn goes_on(&self, frames: usize) -> bool {
        let enough = self.frames.is_some_and(|most| frames as u64 >= most);
        !(enough || ending::is_asked() || self.until.is_some_and(|until| Instant::now() >= until))
    }

    /// The newest picture. Says when the camera goes and when it is back.
    pub fn next(&mut self, until: Instant) -> Next {
        match self.newest.take(until) {
            Taken::New(picture) => {
                if self.gone.take().is_some() {
                    warn(self.quiet, "the camera is back");
                }
                match picture.pixels() {
                    Ok(pixels) => {
                        self.poses.picture(picture.time_s, &pixels);
                        Next::Picture(Box::new((picture, pixels)))
                    }
                    Err(error) => {
                        if self.damaged == 0 {
                            warn(self.quiet, &format!("{error}; such pictures are left out and counted"));
                        }
                        self.damaged += 1;
                        Next::Nothing
                    }
                }
            }
            Taken::Nothing => Next::Nothing,
            Taken::Gone(why) => {
                if self.gone.is_none() {
                    warn(self.quiet, &format!("{why}; waiting for it"));
                    self.gone = Some(why);
                }
                Next::Nothing
            }
            Taken::Ended => Next::Ended,
        }
    }

    /// The poses that have come, for frames up to a time.
    pub fn new_poses(&mut self, last_frame_s: f64) -> Result<Vec<(f64, Pose)>> {
        Ok(self.poses.poses(last_frame_s + AHEAD_S)?)
    }

    /// What was left out, in words. `not_recorded`: for the disk was too slow.
    pub fn drops(&self, not_recorded: u64) -> String {
        let drops = self.newest.drops();
        let parts = [
            (drops.replaced, "replaced by newer ones"),
            (drops.lost, "lost by the driver"),
            (drops.damaged + self.damaged, "damaged"),
            (not_recorded, "more than the disk could take"),
        ];
        let told: Vec<String> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!("{n} {why}")).collect();
        if told.is_empty() { "none dropped".to_owned() } else { format!("dropped: {}", told.join(", ")) }
    }

    /// The closing line.
    pub fn close(&self, what: &str, frames: usize, not_recorded: u64) {
        if !self.quiet {
            let took = fixed(self.began.elapsed().as_secs_f64(), 1);
            say(&format!("{what}{} in {took} s; {}", count(frames, "frame"), self.drops(not_recorded)));
        }
    }
}
