//! Options for skipping frames of a recording, shared by all commands that open one.

use locard_engine::recording::OpenOptions;

#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct Skip {
    /// Leave out frames whose picture repeats the one before; the others are counted anew. Every
    /// picture is decoded first
    #[arg(long)]
    skip_duplicates: bool,
    /// Leave out frames whose picture is missing, instead of refusing the recording; the others are
    /// counted anew
    #[arg(long)]
    skip_missing: bool,
}

impl Skip {
    pub fn over(self, options: OpenOptions) -> OpenOptions {
        let Self { skip_duplicates, skip_missing } = self;
        OpenOptions { skip_duplicates, skip_missing, ..options }
    }
}
