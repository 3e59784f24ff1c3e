//! Whether parts are pieces of one output: same build, inputs, settings, format and adapter,
//! without holes and overlaps.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::ops::Range;

use serde_json::Value;

use super::error::FarmError;
use super::part_record::RecordedPart;
use crate::provenance::{DeviceRecord, InputRecord, OutputKind, SettingsRecord};
use crate::text::quoted;

/// Checks that parts, in order of their frames, belong together and cover `frames`, or, without
/// it, the frames from the first part's to the last one's. With `any_driver` adapters need only be
/// of the same kind; drivers may round differently.
pub fn check_agreement(
    parts: &[RecordedPart],
    frames: Option<&Range<usize>>,
    any_driver: bool,
) -> Result<(), FarmError> {
    let Some((first, others)) = parts.split_first() else {
        return Err(FarmError::Plan("there are no parts to join".to_owned()));
    };
    for part in others {
        check_settings(first, part)?;
        check_device(first, part, any_driver)?;
        check_inputs(first, part)?;
    }
    check_ranges(parts, frames)
}

/// Rejects a part with another program, other settings or another format than the first.
fn check_settings(first: &RecordedPart, part: &RecordedPart) -> Result<(), FarmError> {
    let (a, b) = (first.work(), part.work());
    let program = |part: &RecordedPart| {
        let program = &part.work().program;
        format!("{} {}, build {}", program.name, program.version, program.build)
    };
    compare(first, part, "the program", program(first), program(part))?;
    compare(first, part, "the seed", a.seed.to_string(), b.seed.to_string())?;
    if a.settings != b.settings {
        let value = |settings: &SettingsRecord| serde_json::to_value(settings).unwrap_or_default();
        let name = different_setting(&value(&a.settings), &value(&b.settings)).unwrap_or_default();
        return Err(disagreement(first, part, &format!("the settings ({})", quoted(&name))));
    }
    let format = |part: &RecordedPart| {
        let output = &part.record.output;
        let kind = match output.kind {
            OutputKind::Frames => "frames",
            OutputKind::Video => "video",
            OutputKind::Photograph => "photograph",
        };
        let (width, height, bits, fps) = (output.width, output.height, output.bits, output.fps);
        format!("{} {kind} {width}x{height}, {bits} bits, {fps} frames/s", output.codec)
    };
    compare(first, part, "the output's format", format(first), format(part))
}

/// Name of a setting that differs, with its table: `noise.scale`.
fn different_setting(a: &Value, b: &Value) -> Option<String> {
    let (a, b) = (a.as_object()?, b.as_object()?);
    let key = a.keys().chain(b.keys()).find(|key| a.get(*key) != b.get(*key))?;
    let inner = a.get(key).zip(b.get(key)).and_then(|(a, b)| different_setting(a, b));
    Some(match inner {
        // The table of all parameters has no name in files.
        Some(inner) if key == "parameters" => inner,
        Some(inner) => format!("{key}.{inner}"),
        None => key.clone(),
    })
}

fn check_device(first: &RecordedPart, part: &RecordedPart, any_driver: bool) -> Result<(), FarmError> {
    let (a, b) = (&first.work().device, &part.work().device);
    compare(first, part, "the kind of adapter", a.kind.clone(), b.kind.clone())?;
    if any_driver {
        return Ok(());
    }
    let adapter = |device: &DeviceRecord| format!("{}, driver {}", device.adapter, device.driver);
    compare(first, part, "the adapter (--any-driver accepts others of its kind)", adapter(a), adapter(b))
}

fn compare(first: &RecordedPart, part: &RecordedPart, of: &str, a: String, b: String) -> Result<(), FarmError> {
    if a == b {
        return Ok(());
    }
    Err(disagreement(first, part, &format!("{of}: {} and {}", quoted(&a), quoted(&b))))
}

fn disagreement(first: &RecordedPart, part: &RecordedPart, of: &str) -> FarmError {
    let problem = format!("differs from {} in {of}; recreate one of them", first.path.display());
    FarmError::refused(&part.path, problem)
}

/// Compares the inputs by role, file name and content: machines may have them in different folders.
/// Each part lists the whole recording.
fn check_inputs(first: &RecordedPart, part: &RecordedPart) -> Result<(), FarmError> {
    if first.inputs == part.inputs {
        return Ok(());
    }
    let (a, b) = (input_keys(first), input_keys(part));
    match a.symmetric_difference(&b).next() {
        Some((role, name, _)) => Err(disagreement(first, part, &format!("an input ({role} {})", quoted(name)))),
        None => Ok(()),
    }
}

fn input_keys(part: &RecordedPart) -> BTreeSet<(&str, Cow<'_, str>, &str)> {
    part.inputs.iter().map(input_key).collect()
}

/// Role, file name and digest of an input.
pub(super) fn input_key(input: &InputRecord) -> (&str, Cow<'_, str>, &str) {
    (&input.role, input.path.file_name().unwrap_or_default().to_string_lossy(), &input.sha256)
}

/// Refuses holes and overlaps.
fn check_ranges(parts: &[RecordedPart], frames: Option<&Range<usize>>) -> Result<(), FarmError> {
    let hole = |from: usize, to: usize, path: &std::path::Path| {
        Err(FarmError::refused(path, format!("frames {from}..{to} are missing beside it; make a part of them")))
    };
    for pair in parts.windows(2) {
        let [a, b] = pair else { continue };
        let (before, after) = (a.range(), b.range());
        if after.start > before.end {
            return hole(before.end, after.start, &a.path);
        }
        if after.start < before.end {
            let problem = format!(
                "frames {}..{} are in {} too; leave one of the two out",
                after.start,
                before.end.min(after.end),
                a.path.display()
            );
            return Err(FarmError::refused(&b.path, problem));
        }
    }
    let (Some(frames), Some(first), Some(last)) = (frames, parts.first(), parts.last()) else { return Ok(()) };
    if first.range().start > frames.start {
        return hole(frames.start, first.range().start, &first.path);
    }
    if last.range().end < frames.end {
        return hole(last.range().end, frames.end, &last.path);
    }
    if first.range().start < frames.start || last.range().end > frames.end {
        let outside = if first.range().start < frames.start { first } else { last };
        let problem = format!("has frames outside of {}..{} (--frames); leave it out", frames.start, frames.end);
        return Err(FarmError::refused(&outside.path, problem));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::super::part_record::parts_at;
    use super::super::part_record::tests::{edit, folder_part};
    use super::*;

    /// The refusal of parts `0..2` and `2..4` after a change of the second one's record.
    fn refusal(change: impl FnOnce(&mut Value)) -> String {
        let temp = tempfile::tempdir().unwrap();
        folder_part(temp.path(), 0..2);
        edit(&folder_part(temp.path(), 2..4), change);
        let parts = parts_at(&[temp.path().to_owned()]).unwrap();
        check_agreement(&parts, None, false).unwrap_err().to_string()
    }

    #[test]
    fn part_of_another_build_input_setting_or_adapter_is_refused() {
        type Change = fn(&mut Value);
        let cases: [(Change, &str); 11] = [
            (
                |value| value["program"]["build"] = "b2".into(),
                "the program: locard 0.1.0, build b1 and locard 0.1.0, build b2",
            ),
            (|value| value["seed"] = 1.into(), "the seed: 0 and 1"),
            (|value| value["settings"]["parameters"]["noise"]["scale"] = 0.75.into(), "the settings (noise.scale)"),
            (|value| value["settings"]["mark"] = "x".into(), "the settings (mark)"),
            (|value| value["settings"]["closed_groups"] = 12.into(), "the settings (closed_groups)"),
            (|value| value["output"]["width"] = 3.into(), "the output's format: png frames 2x1"),
            (|value| value["device"]["kind"] = "DiscreteGpu".into(), "the kind of adapter: Cpu and DiscreteGpu"),
            (|value| value["device"]["driver"] = "Mesa 2".into(), "the adapter (--any-driver accepts"),
            (|value| value["inputs"][0]["sha256"] = "ab".into(), "an input (scene s.toml)"),
            (|value| value["inputs"][1]["sha256"] = "f1".into(), "an input (recording 0.png)"),
            (|value| value["inputs"][1]["path"] = "/r/1.png".into(), "an input (recording 0.png)"),
        ];
        for (change, expected) in cases {
            let text = refusal(change);
            assert!(text.contains(expected) && text.contains("part_000002_000004: differs from"), "{text}");
            assert!(text.ends_with("recreate one of them"), "{text}");
        }
    }

    #[test]
    fn inputs_in_another_folder_are_the_same() {
        let temp = tempfile::tempdir().unwrap();
        folder_part(temp.path(), 0..2);
        edit(&folder_part(temp.path(), 2..4), |value| value["inputs"][1]["path"] = "/r/0.png".into());
        check_agreement(&parts_at(&[temp.path().to_owned()]).unwrap(), None, false).unwrap();
    }

    #[test]
    fn any_driver_accepts_another_adapter_of_the_same_kind() {
        let temp = tempfile::tempdir().unwrap();
        folder_part(temp.path(), 0..2);
        edit(&folder_part(temp.path(), 2..4), |value| value["device"]["adapter"] = "lavapipe".into());
        let parts = parts_at(&[temp.path().to_owned()]).unwrap();
        assert!(check_agreement(&parts, None, false).is_err());
        check_agreement(&parts, None, true).unwrap();
    }

    #[test]
    fn holes_overlaps_and_frames_outside_are_refused() {
        let temp = tempfile::tempdir().unwrap();
        let part = |range: Range<usize>| folder_part(temp.path(), range);
        let check = |outputs: &[PathBuf], frames: Option<Range<usize>>| {
            let parts = parts_at(outputs).unwrap();
            check_agreement(&parts, frames.as_ref(), false).map_err(|error| error.to_string())
        };
        let [a, b, c] = [part(0..2), part(2..4), part(5..6)];
        assert_eq!(check(&[b.clone(), a.clone()], Some(0..4)), Ok(()));
        let hole = check(&[a.clone(), b.clone(), c.clone()], None).unwrap_err();
        assert!(hole.contains("000004: frames 4..5 are missing beside it; make a part of them"), "{hole}");
        let overlap = check(&[a.clone(), part(1..4)], None).unwrap_err();
        assert!(overlap.contains("frames 1..2 are in") && overlap.contains("leave one of the two out"), "{overlap}");
        let twice = check(&[a.clone(), a.clone()], None).unwrap_err();
        assert!(twice.contains("frames 0..2 are in"), "{twice}");
        assert!(check(std::slice::from_ref(&b), Some(0..4)).unwrap_err().contains("frames 0..2 are missing"));
        assert!(check(std::slice::from_ref(&a), Some(0..4)).unwrap_err().contains("frames 2..4 are missing"));
        assert!(check(&[a, b], Some(0..3)).unwrap_err().contains("has frames outside of 0..3 (--frames)"));
        assert!(check(&[], None).unwrap_err().contains("no parts to join"));
    }
}
