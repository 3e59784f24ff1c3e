//! Options for opening a recording, shared by the commands that open one.

use locard_engine::recording::OpenOptions;

#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct Skip {
    /// Skip frames that repeat the previous picture, and renumber the others. Every picture is
    /// decoded first
    #[arg(long)]
    skip_duplicates: bool,
    /// Skip frames without a picture file, instead of refusing the recording, and renumber the
    /// others
    #[arg(long)]
    skip_missing: bool,
}

impl Skip {
    /// The options as words of a command line.
    pub fn words(self) -> Vec<String> {
        let Self { skip_duplicates, skip_missing } = self;
        let all = [(skip_duplicates, "--skip-duplicates"), (skip_missing, "--skip-missing")];
        all.iter().filter(|(is_set, _)| *is_set).map(|(_, word)| (*word).to_owned()).collect()
    }

    pub fn apply_to(self, options: OpenOptions) -> OpenOptions {
        let Self { skip_duplicates, skip_missing } = self;
        OpenOptions { skip_duplicates, skip_missing, ..options }
    }
}

/// Options of the commands that composite or export.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct OpenArgs {
    /// Length of a unit, for formats without a scale (nerfstudio, COLMAP, Metashape …)
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    metres_per_unit: f64,
    /// Offset added to frame times when poses are looked up
    #[arg(long, default_value_t = 0.0, value_name = "S", allow_negative_numbers = true)]
    time_offset_s: f64,
    #[command(flatten)]
    skip: Skip,
}

impl OpenArgs {
    /// The options other than defaults, as words of a command line.
    pub fn words(self) -> Vec<String> {
        let Self { metres_per_unit, time_offset_s, skip } = self;
        let mut words = skip.words();
        if metres_per_unit != 1.0 {
            words.push(format!("--metres-per-unit={metres_per_unit}"));
        }
        if time_offset_s != 0.0 {
            words.push(format!("--time-offset-s={time_offset_s}"));
        }
        words
    }

    pub fn options(self) -> OpenOptions {
        let Self { metres_per_unit, time_offset_s, skip } = self;
        skip.apply_to(OpenOptions { metres_per_unit, time_offset_s, ..OpenOptions::default() })
    }
}
