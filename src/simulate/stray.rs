//! A simulated recording in Stray Scanner's export format ([`crate::recording`] reads it). The
//! video is H.264 where a phone's is HEVC. Confidence is 2 within the range of such a sensor, and 0
//! beyond.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::depth::phone_from_site;
use super::encode::{confidence_png, depth_png, encoding};
use super::render::SimulatedPicture;
use super::{Format, SimulateError, Simulation};
use crate::pixels::Pixels;
use crate::sink::{self, OutPath, Sink, SinkOptions};
use crate::source::presentation::Presentation;
use crate::tracking::PoseTrack;

pub const CODES_PER_METRE: f64 = 1000.0;
const MAX_RANGE_M: f32 = 5.0;
pub const FOLDERS: [&str; 2] = ["depth", "confidence"];

/// A file's name relative to the folder, and its bytes.
pub type NamedFile = (String, Vec<u8>);

/// An export in progress.
pub struct StrayScan {
    video: Box<dyn Sink>,
    file: PathBuf,
    odometry: String,
}

impl StrayScan {
    pub fn begin(folder: &Path, simulation: &Simulation) -> Result<Self, SimulateError> {
        let options = simulation.options();
        let file = folder.join("rgb.mp4");
        let written = SinkOptions {
            force: false,
            fps: options.fps,
            times_s: None,
            presentation: Presentation::default(),
            lossless: options.format == Format::Png,
            codec: None,
            soundtrack: None,
            label: None,
            width: options.width_px,
            height: options.height_px,
            bits: 8,
        };
        let video = sink::open(&OutPath::Video(file.clone()), &written)?;
        Ok(Self { video, file, odometry: "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned() })
    }

    /// Adds a frame with its recorded pose; returns its depth and confidence files.
    pub fn add(
        &mut self,
        simulation: &Simulation,
        recorded: &PoseTrack,
        frame: usize,
        codes: Vec<u8>,
        depth: &SimulatedPicture,
    ) -> Result<[NamedFile; 2], SimulateError> {
        let options = simulation.options();
        if let Some(pixels) = Pixels::from_u8(options.width_px, options.height_px, codes) {
            self.video.write(frame, &pixels)?;
        }
        let time_s = simulation.timestamp_s(frame);
        if let Some(pose) = recorded.at_or_nearest(time_s) {
            let at_m = phone_from_site() * pose.position_in_world_m();
            let turn = phone_from_site() * pose.world_from_camera_rotation();
            let numbers = at_m.to_array().into_iter().chain(turn.to_array());
            let numbers: Vec<String> = numbers.map(|number| format!("{number:.9}")).collect();
            // Writing to a string cannot fail.
            let _ = writeln!(self.odometry, "{time_s:.6}, {frame:06}, {}", numbers.join(", "));
        }
        let named = |folder: &str| format!("{folder}/{frame:06}.png");
        let [depth_name, confidence_name] = FOLDERS.map(named);
        let files = (depth_png(depth, CODES_PER_METRE), confidence_png(depth, MAX_RANGE_M));
        Ok([
            (depth_name.clone(), files.0.map_err(encoding(&depth_name))?),
            (confidence_name.clone(), files.1.map_err(encoding(&confidence_name))?),
        ])
    }

    /// Ends the video; returns its file, and the remaining files of the export.
    pub fn finish(self, simulation: &Simulation) -> Result<(PathBuf, [NamedFile; 2]), SimulateError> {
        let Self { video, file, odometry } = self;
        video.finish()?;
        let i = &simulation.geometry().intrinsics;
        let matrix = format!("{},0.0,{}\n0.0,{},{}\n0.0,0.0,1.0\n", i.fx_px, i.cx_px, i.fy_px, i.cy_px);
        let texts = [("odometry.csv", odometry), ("camera_matrix.csv", matrix)];
        Ok((file, texts.map(|(name, text)| (name.to_owned(), text.into_bytes()))))
    }
}
