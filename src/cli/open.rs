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
    pub fn over(self, options: OpenOptions) -> OpenOptions {
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
    pub fn options(self) -> OpenOptions {
        let Self { metres_per_unit, time_offset_s, skip } = self;
        skip.over(OpenOptions { metres_per_unit, time_offset_s, ..OpenOptions::default() })
    }
}
