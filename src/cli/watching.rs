//! Options of a camera and its poses, and a capture session on the command line.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use super::{interrupt, print_message, warn};
use locard_engine::camera::Camera;
use locard_engine::coding::{ColorMatrix, ColorRange};
use locard_engine::live::{self, CaptureEvent, DelayMode, LiveCapture, LiveError, LiveInput, LiveOptions, LiveSpec};
use locard_engine::recording::recorder::RecordingInfo;
use locard_engine::text::{count, fixed};
use locard_engine::webcam::{DriverName, Layout};

#[derive(clap::Args)]
pub struct CameraArgs {
    /// The camera: its number or device (`locard doctor` lists them), or a video that is played in
    /// its place
    #[arg(long, value_name = "N|VIDEO")]
    pub camera: String,
    /// Source of the poses: tags (printed by `locard board`), tags:BOARD.toml,
    /// opentrackio://HOST:PORT, freed://HOST:PORT, file:RECORDING (played again), or none
    #[arg(long, default_value = "none", value_name = "SOURCE")]
    pub pose: String,
    /// Delay of the camera, added to the time of each pose, seconds. auto: the delay that fits the
    /// pictures best, found while they arrive; the camera has to turn
    #[arg(long, value_name = "S|auto", default_value = "0", allow_hyphen_values = true, value_parser = LiveOptions::parse_delay)]
    delay: DelayMode,
    /// Smooth poses from tags by this time constant, seconds: steadier, and as much later; by
    /// default they are not smoothed
    #[arg(long, value_name = "S", value_parser = LiveOptions::parse_time_constant_s)]
    smooth: Option<f64>,
    #[command(flatten)]
    pub pictures: PicturesArgs,
}

/// Requested properties of a camera.
#[derive(clap::Args)]
pub struct PicturesArgs {
    /// Which driver reads the camera: v4l2 (Linux; the default there) or nokhwa
    #[arg(long, value_parser = driver)]
    driver: Option<DriverName>,
    /// Size of the pictures, px; the profile's, else 640x480
    #[arg(long, value_name = "WxH", value_parser = LiveOptions::parse_size)]
    size: Option<(u32, u32)>,
    /// Pictures per second; by default 30
    #[arg(long, value_name = "HZ", value_parser = LiveOptions::parse_rate_hz)]
    rate: Option<f64>,
    /// Format of the camera's pictures: rgb, yuyv, nv12, mjpeg or grey; by default, the best at
    /// this size and rate
    #[arg(long, value_parser = layout)]
    format: Option<Layout>,
    /// The camera's range of Y', overriding its driver: limited (16 to 235) or full
    #[arg(long, value_parser = range)]
    range: Option<ColorRange>,
    /// The camera's colour matrix, overriding its driver: bt601, bt709 or bt2020
    #[arg(long, value_parser = matrix)]
    matrix: Option<ColorMatrix>,
    /// End after this many frames
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// End after this many seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// No messages but errors
    #[arg(long, short)]
    pub quiet: bool,
}

impl CameraArgs {
    /// The specification of the camera and its poses.
    pub fn spec(&self) -> LiveSpec {
        let options = LiveOptions { delay: self.delay, smooth_s: self.smooth, ..self.pictures.options() };
        LiveSpec { options, ..LiveSpec::new(&self.camera, &self.pose) }
    }
}

impl PicturesArgs {
    fn options(&self) -> LiveOptions {
        let &Self { driver, size, rate: rate_hz, format: layout, range, matrix, .. } = self;
        LiveOptions { driver, size, rate_hz, layout, range, matrix, ..LiveOptions::default() }
    }

    /// True if the session has a limit of frames or seconds.
    #[cfg(feature = "window")]
    pub fn has_limit(&self) -> bool {
        self.frames.is_some() || self.seconds.is_some()
    }

    /// The name of a given option that applies to cameras alone, if any.
    pub fn conflicting_option(&self) -> Option<&'static str> {
        let options = [
            ("--driver", self.driver.is_some()),
            ("--size", self.size.is_some()),
            ("--rate", self.rate.is_some()),
            ("--format", self.format.is_some()),
            ("--range", self.range.is_some()),
            ("--matrix", self.matrix.is_some()),
            ("--frames", self.frames.is_some()),
            ("--seconds", self.seconds.is_some()),
        ];
        options.into_iter().find_map(|(name, is_given)| is_given.then_some(name))
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| *seconds > 0.0 && *seconds <= 1e6);
    seconds.ok_or_else(|| "expected a number of seconds above 0".to_owned())
}

fn layout(text: &str) -> Result<Layout, String> {
    Layout::of_name(text).ok_or_else(|| format!("expected {}", Layout::PREFERRED.map(Layout::name).join(", ")))
}

fn driver(text: &str) -> Result<DriverName, String> {
    let names: Vec<&str> = DriverName::AVAILABLE.iter().map(|driver| driver.name()).collect();
    DriverName::of_name(text).ok_or_else(|| match names.as_slice() {
        [] => "this program was built without cameras".to_owned(),
        _ => format!("expected {}", names.join(", ")),
    })
}

fn range(text: &str) -> Result<ColorRange, String> {
    match text {
        "limited" => Ok(ColorRange::Limited),
        "full" => Ok(ColorRange::Full),
        _ => Err("expected limited, full".to_owned()),
    }
}

fn matrix(text: &str) -> Result<ColorMatrix, String> {
    match text {
        "bt601" => Ok(ColorMatrix::Bt601),
        "bt709" => Ok(ColorMatrix::Bt709),
        "bt2020" => Ok(ColorMatrix::Bt2020),
        _ => Err("expected bt601, bt709, bt2020".to_owned()),
    }
}

/// A camera with its negotiated format, and the source of its poses.
pub struct OpenCamera {
    pub opened: LiveInput,
    frames: Option<u64>,
    seconds: Option<f64>,
    quiet: bool,
}

/// A running capture, until it is interrupted.
pub struct CameraSession {
    capture: LiveCapture,
    frames: Option<u64>,
    until: Option<Instant>,
    /// The last reported reason of an outage.
    outage: Option<String>,
    is_damaged: bool,
    began: Instant,
    quiet: bool,
}

impl OpenCamera {
    /// Opens the camera and its poses. `profile` names the camera's profile, if one is given.
    pub fn open(args: &CameraArgs, profile: Option<&Path>) -> Result<Self> {
        let profile_camera = profile.map(|path| live::camera_of_profile(path, &args.pose)).transpose()?;
        Self::of(&args.spec(), &args.pictures, profile_camera.as_ref())
    }

    /// Opens a camera without poses.
    pub fn without_poses(camera: &str, pictures: &PicturesArgs) -> Result<Self> {
        let spec = LiveSpec { options: pictures.options(), ..LiveSpec::new(camera, "none") };
        Self::of(&spec, pictures, None)
    }

    fn of(spec: &LiveSpec, args: &PicturesArgs, profile_camera: Option<&Camera>) -> Result<Self> {
        let opened = live::open(spec, profile_camera)?;
        warn(args.quiet, &opened.description);
        opened.camera.negotiated.warnings.iter().for_each(|warning| warn(args.quiet, warning));
        // Commands that need an unknown lens report it themselves.
        let lenses = opened.lens.iter().filter(|lens| lens.camera.geometry.is_some() || profile_camera.is_some());
        lenses.for_each(|lens| warn(args.quiet, &lens.description));
        let (frames, seconds, quiet) = (args.frames, args.seconds, args.quiet);
        Ok(Self { opened, frames, seconds, quiet })
    }

    /// The information about camera and poses in a recording, with the camera's profile.
    pub fn about(&self, profile: Option<&Path>) -> Result<RecordingInfo> {
        let read =
            |path: &Path| std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()));
        Ok(self.opened.about(profile.map(read).transpose()?))
    }

    /// Starts the camera. From here on Ctrl-C finishes the output, and then ends the program.
    pub fn start(self) -> Result<CameraSession> {
        let capture = LiveCapture::new(self.opened.camera.start()?, self.opened.poses);
        interrupt::defer_first();
        let began = Instant::now();
        Ok(CameraSession {
            capture,
            frames: self.frames,
            until: self.seconds.map(|seconds| began + Duration::from_secs_f64(seconds)),
            outage: None,
            is_damaged: false,
            began,
            quiet: self.quiet,
        })
    }
}

impl CameraSession {
    /// True until the limit of frames or seconds is reached, or the program is interrupted.
    pub fn is_running(&self, frames: usize) -> bool {
        let enough = self.frames.is_some_and(|max_frames| frames as u64 >= max_frames);
        !(enough || interrupt::is_requested() || self.until.is_some_and(|until| Instant::now() >= until))
    }

    /// The newest picture. Reports outages of the camera and their end.
    pub fn next(&mut self, until: Instant) -> CaptureEvent {
        let next = self.capture.next(until);
        let outage = self.capture.outage().map(ToString::to_string);
        if outage != self.outage {
            let text =
                outage.as_ref().map_or_else(|| "the camera is back".to_owned(), |why| format!("{why}; waiting for it"));
            warn(self.quiet, &text);
            self.outage = outage;
        }
        if let Some(error) = self.capture.decode_error().filter(|_| !self.is_damaged) {
            warn(self.quiet, &format!("{error}; such pictures are left out and counted"));
            self.is_damaged = true;
        }
        next
    }

    /// Passes new poses to `take`, and prints the capture's message about them.
    pub fn take_poses(&mut self, take: impl FnOnce(&mut LiveCapture) -> Result<(), LiveError>) -> Result<()> {
        take(&mut self.capture)?;
        if let Some(text) = self.capture.take_message() {
            warn(self.quiet, &text);
        }
        Ok(())
    }

    /// The reason why there is no pose now, if it is known.
    pub fn no_pose_reason(&self) -> Option<String> {
        self.capture.no_pose_reason()
    }

    /// A text about dropped pictures. `not_recorded`: because the disk was too slow.
    pub fn drops(&self, not_recorded: u64) -> String {
        let drops = self.capture.drops();
        let parts = [
            (drops.replaced, "replaced by newer ones"),
            (drops.dropped_frames, "lost by the driver"),
            (drops.damaged, "damaged"),
            (not_recorded, "more than the disk could take"),
        ];
        let texts: Vec<String> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!("{n} {why}")).collect();
        let dropped =
            if texts.is_empty() { "none dropped".to_owned() } else { format!("dropped: {}", texts.join(", ")) };
        match drops.arrival_timed {
            0 => dropped,
            n => format!("{dropped}; {n} timed by their arrival, because the driver's time was implausible"),
        }
    }

    /// The error if there was no frame.
    pub fn no_picture_error(&self) -> String {
        let took_s = fixed(self.began.elapsed().as_secs_f64(), 2);
        format!(
            "no picture came from the camera in {took_s} s; give it longer, or check that it is plugged in and no other program uses it"
        )
    }

    /// Prints the closing line, and that of a stream of poses.
    pub fn close(&self, what: &str, frames: usize, not_recorded: u64) {
        if !self.quiet {
            let took = fixed(self.began.elapsed().as_secs_f64(), 1);
            print_message(&format!("{what}{} in {took} s; {}", count(frames, "frame"), self.drops(not_recorded)));
            self.capture.summary().into_iter().for_each(|line| print_message(&line));
        }
    }
}
