//! Options of the labels that mark a file as a composite.

use super::print_message;
use locard_engine::label::DigitalSourceType;

#[derive(clap::Args)]
pub struct LabelArgs {
    /// Leave the labels that mark them as composites out of the files
    #[arg(long)]
    unlabelled: bool,
}

impl LabelArgs {
    /// True if files are labelled.
    pub fn is_labelled(&self) -> bool {
        !self.unlabelled
    }

    /// Reports the contents that unlabelled files lack, also if the program is quiet.
    pub fn warn(&self, source_type: DigitalSourceType) {
        if self.unlabelled {
            print_message(&format!(
                "--unlabelled: the output does not state its digital source type ({}), program and frame; nobody can \
                 tell from the file that it is no photograph",
                source_type.description()
            ));
        }
    }
}
