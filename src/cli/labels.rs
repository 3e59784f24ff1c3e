//! Options of the labels and marks that show that a file is a composite.

use super::print_message;
use locard_engine::label::DigitalSourceType;
use locard_engine::sink::lettering::missing_characters;

/// Longest text of a mark.
const MAX_MARK_CHARACTERS: usize = 100;
/// Text of a mark without one of its own.
const DEFAULT_MARK: &str = "Composite with virtual evidence";

#[derive(clap::Args)]
pub struct LabelArgs {
    /// Leave the labels that mark them as composites out of the files
    #[arg(long)]
    unlabelled: bool,
}

#[derive(clap::Args)]
pub struct MarkArgs {
    /// Draw a mark into the lower left corner of each picture
    #[arg(long, value_name = "TEXT", num_args = 0..=1, default_missing_value = DEFAULT_MARK, value_parser = mark_text)]
    pub mark: Option<String>,
}

/// Evidence in an unlabelled file that it is no photograph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trace {
    /// A photograph's metadata.
    Exif,
    /// The visible mark.
    Mark,
}

impl MarkArgs {
    /// The visible mark, if there is one.
    pub fn trace(&self) -> Option<Trace> {
        self.mark.as_ref().map(|_| Trace::Mark)
    }
}

impl LabelArgs {
    /// True if files are labelled.
    pub fn is_labelled(&self) -> bool {
        !self.unlabelled
    }

    /// Reports the contents that unlabelled files lack and those that remain, also if the program
    /// is quiet.
    pub fn warn(&self, source_type: DigitalSourceType, traces: impl IntoIterator<Item = Trace>) {
        if self.unlabelled {
            print_message(&unlabelled(source_type, &traces.into_iter().collect::<Vec<_>>()));
        }
    }
}

fn unlabelled(source_type: DigitalSourceType, traces: &[Trace]) -> String {
    const EXIF: &str = "its Exif (make and model \"Locard\", software, frame)";
    let others = if traces.contains(&Trace::Exif) { "" } else { ", program and frame" };
    let shows = match traces {
        [] => "nobody can tell from the file",
        [Trace::Mark] => "only the mark in the picture shows",
        [Trace::Exif] => &format!("only {EXIF} shows"),
        _ => &format!("only {EXIF} and the mark in the picture show"),
    };
    let description = source_type.description();
    format!(
        "--unlabelled: the output does not state its digital source type ({description}){others}; {shows} that it is no \
         photograph"
    )
}

/// The text of a mark.
fn mark_text(text: &str) -> Result<String, String> {
    let missing = missing_characters(text);
    if text.trim().is_empty() || text.chars().any(char::is_control) || text.chars().count() > MAX_MARK_CHARACTERS {
        return Err(format!("expected one line of 1 to {MAX_MARK_CHARACTERS} characters"));
    }
    if !missing.is_empty() {
        return Err(format!("the font has no {missing}; expected Latin, Greek or Cyrillic letters"));
    }
    Ok(text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warning_of_unlabelled_files_names_the_traces_that_remain() {
        let text = |traces: &[Trace]| unlabelled(DigitalSourceType::CompositeWithSyntheticElements, traces);
        let none = text(&[]);
        assert!(
            none.ends_with("), program and frame; nobody can tell from the file that it is no photograph"),
            "{none}"
        );
        let marked = text(&[Trace::Mark]);
        assert!(marked.ends_with("and frame; only the mark in the picture shows that it is no photograph"), "{marked}");
        let photo = text(&[Trace::Exif, Trace::Mark]);
        assert!(
            !photo.contains("program and frame") && photo.contains("virtual objects); only its Exif (make "),
            "{photo}"
        );
        assert!(photo.ends_with("frame) and the mark in the picture show that it is no photograph"), "{photo}");
    }
}
