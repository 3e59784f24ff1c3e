//! The command line that reproduces the displayed composite.

use std::path::Path;

use super::project::Project;
use locard_engine::params::{Params, Value};
use locard_engine::profile::ShotSettings;
use locard_engine::text::number;

/// A line for a shell, with steps to take before it is run.
#[derive(Clone, Debug, PartialEq)]
pub struct CommandLine {
    pub text: String,
    pub before: Vec<&'static str>,
}

/// `locard composite` of one frame with the current settings: unsaved changes become `--set`
/// options.
pub fn composite(project: &Project, frame: usize) -> CommandLine {
    let mut words = vec!["locard".to_owned(), "composite".to_owned()];
    let name = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string();
    words.push(name(&project.shot().recording.path));
    words.extend(["--scene".to_owned(), name(&project.scene_path())]);
    if let Some(profile) = project.profile.as_ref().filter(|path| path.exists()) {
        words.extend(["--profile".to_owned(), name(profile)]);
    }
    let (files, now) = (project.saved(), project.edit());
    let mut changes = ShotSettings::between(files.look(), now.look());
    // `--set` overrides each frame's own exposure, as a scene file's settings do.
    let exposure = now.rig.exposure.table();
    let overrules = files.settings.overrule_recorded_exposure || changes.has_table(exposure);
    let is_exposed_alike = overrules == now.settings.overrule_recorded_exposure;
    if !is_exposed_alike {
        changes = changes.filtered(|table, _| table != exposure);
    }
    for set in project.shot().sets().iter().cloned().chain(sets(&changes)) {
        words.extend(["--set".to_owned(), set]);
    }
    if now.settings.seed != 0 {
        words.extend(["--seed".to_owned(), now.settings.seed.to_string()]);
    }
    let unit_m = project.shot().opened_unit_m();
    if unit_m != 1.0 {
        words.extend(["--metres-per-unit".to_owned(), number(unit_m)]);
    }
    words.extend(["--frames".to_owned(), format!("{frame}..{}", frame + 1), "-o".to_owned(), "composited".to_owned()]);
    let mut before = Vec::new();
    let is_saved = files.scene == now.scene && !project.scene_is_stale() && is_exposed_alike;
    if !is_saved || !project.scene_path().exists() {
        before.push("Save the scene first: the command reads it from its file.");
    }
    if changes.noise().is_some() {
        before.push("Save first: a camera's noise cannot be given by --set.");
    }
    CommandLine { text: words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" "), before }
}

/// Values of `--set` options that turn the files' settings into the current ones.
fn sets(changes: &ShotSettings) -> Vec<String> {
    let text = |value: &Value| match value {
        Value::Number(n) => number(*n),
        Value::Text(text) => text.clone(),
        other => other.to_string(),
    };
    let set = |(table, name, value)| format!("{table}.{name}={}", text(value));
    let mut sets: Vec<String> = changes.values().map(set).collect();
    // Of alternative parameters, setting one unsets the other: options without a value come first.
    sets.sort_by_key(|set| !set.ends_with("=none"));
    sets
}

/// Quotes a word for a POSIX shell, or for PowerShell on Windows.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-=:,+".contains(c) || (cfg!(windows) && c == '\\');
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    let escaped = if cfg!(windows) { "''" } else { "'\\''" };
    format!("'{}'", word.replace('\'', escaped))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(not(windows))]
    fn words_are_quoted_for_a_shell() {
        for (word, expected) in [
            ("noise.scale=1e-7", "noise.scale=1e-7"),
            ("it's a case", "'it'\\''s a case'"),
            ("$HOME", "'$HOME'"),
            ("", "''"),
            ("größe", "'größe'"),
        ] {
            assert_eq!(quoted(word), expected);
        }
    }
}
