//! The work that a record describes: program, command, device, inputs, settings.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::digests::file_digest;
use crate::params::{self, Value};
use crate::shot::Shot;
use crate::source::ffmpeg;

/// The program, its inputs and its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorkRecord {
    pub program: ProgramRecord,
    /// Versions of the other programs that decoded or encoded video, by name: the first line that
    /// `-version` prints.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub programs: BTreeMap<String, String>,
    pub command: CommandRecord,
    pub device: DeviceRecord,
    /// Seed of the noise.
    pub seed: u64,
    pub inputs: Vec<InputRecord>,
    pub settings: SettingsRecord,
}

impl WorkRecord {
    /// The running program with a shot on a device, without its inputs.
    pub fn begun(shot: &Shot, device: &wgpu::AdapterInfo) -> Self {
        let programs = if shot.recording.is_video() { video_programs() } else { BTreeMap::new() };
        let (device, seed, settings) = (DeviceRecord::of(device), shot.settings.seed, SettingsRecord::of(shot));
        Self { programs, device, seed, settings, ..Self::without_shot(Vec::new()) }
    }

    /// The running program with inputs, without a shot and a device: that of a case card.
    pub fn without_shot(inputs: Vec<InputRecord>) -> Self {
        Self {
            program: ProgramRecord::current(),
            programs: BTreeMap::new(),
            command: CommandRecord::current(),
            device: DeviceRecord::none(),
            seed: 0,
            inputs,
            settings: SettingsRecord::default(),
        }
    }
}

/// The program that wrote an output.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgramRecord {
    pub name: String,
    pub version: String,
    /// SHA-256 of the executable file; empty if it could not be read.
    pub build: String,
}

/// Versions of the installed programs that decode and encode video.
pub fn video_programs() -> BTreeMap<String, String> {
    ffmpeg::version().ok().map(|version| ("ffmpeg".to_owned(), version)).into_iter().collect()
}

/// The command line.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandRecord {
    /// The arguments, without the program's own name.
    pub arguments: Vec<String>,
    /// The folder to which relative paths refer.
    pub folder: PathBuf,
}

/// The graphics device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DeviceRecord {
    pub adapter: String,
    pub driver: String,
    /// `Cpu`, `IntegratedGpu`, `DiscreteGpu`, `VirtualGpu` or `Other`; `None` without a device.
    pub kind: String,
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputRecord {
    /// `recording`, `profile`, `scene` (with its models) or `analysis`; `card` of a case card.
    pub role: String,
    pub path: PathBuf,
    pub bytes: u64,
    pub sha256: String,
}

/// All settings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SettingsRecord {
    /// Every parameter of the camera and the effects, by table and name.
    pub parameters: BTreeMap<String, BTreeMap<String, Value>>,
    /// Effects that were off.
    pub without: Vec<String>,
    /// Converted to standard dynamic range.
    #[serde(default)]
    pub sdr: bool,
    /// Text of the visible mark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<String>,
    /// True without labels in the files.
    #[serde(default)]
    pub unlabelled: bool,
    /// Frames of each closed group of pictures of a video.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closed_groups: Option<u32>,
}

impl ProgramRecord {
    /// The running program.
    pub fn current() -> Self {
        let build = std::env::current_exe().and_then(|path| file_digest(&path));
        Self {
            name: "locard".to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            build: build.map(|digest| digest.sha256).unwrap_or_default(),
        }
    }
}

impl CommandRecord {
    /// The process' command line.
    pub fn current() -> Self {
        let arguments = std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned()).collect();
        Self { arguments, folder: std::env::current_dir().unwrap_or_default() }
    }
}

impl DeviceRecord {
    fn none() -> Self {
        Self { adapter: "none".to_owned(), driver: String::new(), kind: "None".to_owned() }
    }

    pub fn of(info: &wgpu::AdapterInfo) -> Self {
        Self {
            adapter: info.name.clone(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            kind: format!("{:?}", info.device_type),
        }
    }
}

impl SettingsRecord {
    /// The settings of a shot.
    pub fn of(shot: &Shot) -> Self {
        let tables = shot.rig.tables().into_iter().chain(shot.settings.tables());
        Self {
            parameters: tables.map(|table| (table.table().to_owned(), params::values(table))).collect(),
            without: shot.settings.disabled().map(str::to_owned).collect(),
            ..Self::default()
        }
    }
}
