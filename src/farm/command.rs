//! The commands of a farm's tasks, independent of the engine that runs them.

use std::path::PathBuf;

/// A folder that tasks read or write, as a parameter of a job template: engines that copy files to
/// their machines map it.
#[derive(Clone, Debug, PartialEq)]
pub struct PathParameter {
    /// Name in the template.
    pub name: &'static str,
    pub description: &'static str,
    /// Absolute.
    pub path: PathBuf,
    /// A file in the folder `path` that commands name; `None`: the path itself.
    pub file: Option<String>,
    /// `DIRECTORY` or `FILE`.
    pub object_type: &'static str,
    /// `IN` or `OUT`.
    pub data_flow: &'static str,
}

impl PathParameter {
    /// The path that commands name.
    pub fn named_path(&self) -> PathBuf {
        self.file.as_ref().map_or_else(|| self.path.clone(), |file| self.path.join(file))
    }
}

/// A word of a command line.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Word {
    Text(String),
    Path(PathParameter),
    /// The range of frames of a task, as in `40..50`.
    Frames,
}

impl Word {
    /// The word as a format string of Open Job Description.
    pub fn as_format_string(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Frames => "{{Task.Param.Frames}}".to_owned(),
            Self::Path(parameter) => match &parameter.file {
                Some(file) => format!("{{{{Param.{}}}}}/{file}", parameter.name),
                None => format!("{{{{Param.{}}}}}", parameter.name),
            },
        }
    }

    /// The word for a POSIX shell. `frames` stands for the task's range and is not quoted.
    pub fn as_shell(&self, frames: &str) -> String {
        match self {
            Self::Text(text) => shell_quoted(text),
            Self::Frames => frames.to_owned(),
            Self::Path(parameter) => shell_quoted(&parameter.named_path().to_string_lossy()),
        }
    }
}

/// A text as one word of a POSIX shell.
pub(super) fn shell_quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// A command line for a POSIX shell.
pub(super) fn shell_line(words: &[Word], frames: &str) -> String {
    words.iter().map(|word| word.as_shell(frames)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shell_words_with_special_characters_are_quoted() {
        for (text, expected) in
            [("a/b.toml", "a/b.toml"), ("a b", "'a b'"), ("it's", r"'it'\''s'"), ("", "''"), ("$x", "'$x'")]
        {
            assert_eq!(shell_quoted(text), expected);
        }
    }

    #[test]
    fn path_is_a_parameter_in_templates_and_a_path_in_shells() {
        let scene = PathParameter {
            name: "SceneFolder",
            description: "",
            path: "/my scenes".into(),
            file: Some("a.toml".to_owned()),
            object_type: "DIRECTORY",
            data_flow: "IN",
        };
        assert_eq!(Word::Path(scene.clone()).as_format_string(), "{{Param.SceneFolder}}/a.toml");
        assert_eq!(Word::Path(scene).as_shell("x"), "'/my scenes/a.toml'");
        assert_eq!(
            (Word::Frames.as_format_string().as_str(), Word::Frames.as_shell("{}").as_str()),
            ("{{Task.Param.Frames}}", "{}")
        );
    }
}
