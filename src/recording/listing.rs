//! Lists of files and values by time, as in the TUM RGB-D benchmark, and folders of pictures.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use super::RecordingError;
use crate::camera::exposure::MAX_EXPOSURE_S;
use crate::fit::quantile::upper_median;
use crate::frame::FrameExposure;
use crate::source::{SourceError, still_format};
use crate::text::{self, number, quoted, reason};
use crate::tracking::records::{self, TextError};

/// Reads a list of `timestamp filename` lines: times in seconds, files relative to the list.
pub fn read_pictures(list: &Path) -> Result<Vec<(f64, PathBuf)>, TextError> {
    let folder = list.parent().unwrap_or(Path::new(""));
    let names = parse_pictures(&records::read(list)?, list)?;
    Ok(names.into_iter().map(|(time_s, name)| (time_s, folder.join(name))).collect())
}

/// A frame of a native list: time, file, and opacity of the virtual layer.
pub type ListedFrame<N> = (f64, N, f64);

/// Prefix of the opacity at a line's end.
const OPACITY_PREFIX: &str = " opacity=";
/// The prefix in recordings of earlier versions.
const EARLIER_OPACITY_PREFIX: &str = " presence=";

/// A frame's file name, and the text of its opacity, if any.
fn split_opacity(rest: &str) -> (&str, Option<&str>) {
    let split = [OPACITY_PREFIX, EARLIER_OPACITY_PREFIX].into_iter().filter_map(|prefix| rest.rsplit_once(prefix));
    // The last one on the line.
    split.max_by_key(|(name, _)| name.len()).map_or((rest, None), |(name, text)| (name, Some(text)))
}

/// Parses a list of `timestamp filename` lines, each of which may end with ` opacity=0.5`: 0 to 1,
/// default 1.
pub fn frames(text: &str, list: &Path) -> Result<Vec<ListedFrame<PathBuf>>, TextError> {
    let folder = list.parent().unwrap_or(Path::new(""));
    let frame = |rest: &str| {
        let (name, text) = split_opacity(rest);
        Ok((folder.join(file_name(name, NO_NAME)?), text.map_or(Ok(1.0), opacity)?))
    };
    Ok(by_time(text, list, frame)?.into_iter().map(|(time_s, (file, opacity))| (time_s, file, opacity)).collect())
}

fn opacity(text: &str) -> Result<f64, String> {
    let opacity = text.trim().parse().ok().filter(|opacity| (0.0..=1.0).contains(opacity));
    opacity.ok_or_else(|| format!("opacity is `{}`; expected a number from 0 to 1", quoted(text)))
}

/// Frames as text, which [`frames`] reads back bit for bit. The opacity is written if it is not 1.
pub fn write_frames<'a>(entries: impl IntoIterator<Item = ListedFrame<&'a str>>) -> Result<String, String> {
    let mut text = HEAD.to_owned();
    for (time_s, name, opacity) in entries {
        text += &line(time_s, name)?;
        if opacity != 1.0 {
            text += &format!("{OPACITY_PREFIX}{}", number(opacity));
        }
        text += "\n";
    }
    Ok(text)
}

const HEAD: &str = "# timestamp filename\n";
const NO_NAME: &str = "the file's name is missing (a line is `timestamp filename`)";

/// A line without its line break.
fn line(time_s: f64, name: &str) -> Result<String, String> {
    let is_ambiguous = split_opacity(name).1.is_some();
    if name.is_empty() || name.trim() != name || name.contains(['\n', '\r']) || is_ambiguous {
        return Err(format!("a list cannot hold the name \"{}\"", quoted(name)));
    }
    Ok(format!("{} {name}", number(time_s)))
}

/// A list of pictures as text, which [`read_pictures`] reads back bit for bit. Fails on a name that
/// a line cannot contain.
pub fn write_pictures<'a>(entries: impl IntoIterator<Item = (f64, &'a str)>) -> Result<String, String> {
    write_frames(entries.into_iter().map(|(time_s, name)| (time_s, name, 1.0)))
}

/// A list of exposures as text, which [`parse_exposures`] reads back bit for bit. Exposures without
/// a time are left out.
pub fn write_exposures(entries: &[(f64, FrameExposure)]) -> String {
    let head = "# timestamp exposure_time_s gain\n".to_owned();
    let exposures = entries.iter().filter_map(|(time_s, exposure)| Some((time_s, exposure.time_s?, exposure.gain)));
    exposures.fold(head, |text, (time_s, exposure_s, gain)| {
        let gain = gain.map_or_else(String::new, |gain| format!(" {}", number(gain)));
        text + &format!("{} {}{gain}\n", number(*time_s), number(exposure_s))
    })
}

fn parse_pictures(text: &str, list: &Path) -> Result<Vec<(f64, String)>, TextError> {
    by_time(text, list, |rest| file_name(rest, NO_NAME))
}

/// Maximum length of a path on any system, bytes.
const MAX_NAME_BYTES: usize = 4096;

/// The file name at a line's end; `missing` is the error if there is none.
pub fn file_name(rest: &str, missing: &str) -> Result<String, String> {
    match rest.trim() {
        "" => Err(missing.to_owned()),
        name if name.len() > MAX_NAME_BYTES => {
            Err(format!("the file's name is `{}`; expected up to {MAX_NAME_BYTES} bytes", quoted(name)))
        }
        name => Ok(name.to_owned()),
    }
}

/// Maximum gain of a sensor: twenty stops.
const MAX_GAIN: f64 = 1e6;

/// A list of `timestamp exposure_time_s gain` lines; the gain is optional.
pub fn parse_exposures(text: &str, list: &Path) -> Result<Vec<(f64, FrameExposure)>, TextError> {
    by_time(text, list, |mut rest| {
        let time_s = Some(number_above_zero(&mut rest, "exposure_time_s", MAX_EXPOSURE_S)?);
        let gain = if rest.trim().is_empty() { None } else { Some(number_above_zero(&mut rest, "gain", MAX_GAIN)?) };
        records::end(rest)?;
        Ok(FrameExposure { time_s, gain, ..FrameExposure::default() })
    })
}

fn number_above_zero(rest: &mut &str, name: &str, max: f64) -> Result<f64, String> {
    match records::number(rest, name)? {
        value if value > 0.0 && value <= max => Ok(value),
        value => Err(format!("{name} is {}; expected above 0, at most {max}", number(value))),
    }
}

/// Lines that begin with a timestamp; the timestamps must not decrease.
pub(super) fn by_time<T>(
    text: &str,
    list: &Path,
    mut parse: impl FnMut(&str) -> Result<T, String>,
) -> Result<Vec<(f64, T)>, TextError> {
    let mut entries: Vec<(f64, T)> = Vec::new();
    for (line, mut rest) in records::records(text) {
        let refuse = |problem: String| TextError::line(list, line, problem);
        let time_s = records::number(&mut rest, "timestamp").map_err(refuse)?;
        if let Some((before_s, _)) = entries.last().filter(|before| time_s < before.0) {
            return Err(refuse(format!("the time runs backwards: {} after {}", number(time_s), number(*before_s))));
        }
        entries.push((time_s, parse(rest).map_err(refuse)?));
    }
    Ok(entries)
}

/// The entry nearest in time among ascending ones; `None` if none is within `within_s`.
pub fn nearest<T>(entries: &[(f64, T)], time_s: f64, within_s: f64) -> Option<&(f64, T)> {
    let after = entries.partition_point(|e| e.0 < time_s);
    let candidates = [after.checked_sub(1).and_then(|i| entries.get(i)), entries.get(after)];
    let distance = |entry: &&(f64, T)| (entry.0 - time_s).abs();
    let best = candidates.into_iter().flatten().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    (distance(&best) <= within_s).then_some(best)
}

/// The pictures of a folder in the order of their names, with numbers by value.
pub fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let failed = |source| SourceError::Read { file: folder.to_owned(), source };
    let mut files = still_format::pictures_in(folder).map_err(failed)?;
    files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

/// The error for a missing picture: with the line of the list that references it, if any, and how
/// many of `all` are missing.
pub fn missing_picture<'a>(
    lists: &[PathBuf],
    error: SourceError,
    all: impl ExactSizeIterator<Item = &'a PathBuf>,
) -> RecordingError {
    let SourceError::Read { file, source } = &error else { return error.into() };
    let (count, is_missing) = (all.len(), source.kind() == std::io::ErrorKind::NotFound);
    let missing = if is_missing { all.filter(|file| !file.exists()).count() } else { 0 };
    let counted = match missing {
        0 => String::new(),
        1 => format!(" (1 of {} is missing; --skip-missing leaves it out)", text::count(count, "picture")),
        _ => format!(" ({missing} of {} are missing; --skip-missing leaves them out)", text::count(count, "picture")),
    };
    let problem = format!("cannot be read: {}{counted}", reason(source));
    for list in lists {
        let text = records::read(list).unwrap_or_default();
        // The name follows a time.
        let name = |record: &str| {
            let rest = record.split_once([' ', '\t', ','])?.1;
            Some(split_opacity(rest).0.trim().to_owned())
        };
        let names = |record: &str| name(record).is_some_and(|name| !name.is_empty() && file.ends_with(name));
        if let Some((line, _)) = records::records(&text).find(|(_, record)| names(record)) {
            return TextError::line(list, line, format!("{}: {problem}", file.display())).into();
        }
    }
    RecordingError::content(file, problem)
}

/// A warning if numbers are missing in the names of pictures, given in order.
pub fn missing_numbers(files: &[PathBuf]) -> Option<String> {
    let numbered = |file: &PathBuf| {
        let stem = file.file_stem()?.to_string_lossy().into_owned();
        let name = stem.trim_end_matches(|c: char| c.is_ascii_digit());
        Some((name.to_owned(), stem[name.len()..].parse::<u64>().ok()?))
    };
    let numbers: Vec<_> = files.iter().map(numbered).collect::<Option<_>>()?;
    let step = |pair: &[(String, u64)]| (pair[0].0 == pair[1].0).then(|| pair[1].1.checked_sub(pair[0].1)).flatten();
    let steps: Vec<u64> = numbers.windows(2).map(step).collect::<Option<_>>()?;
    let usual = upper_median(steps.iter().copied())?;
    let first = steps.iter().position(|step| *step > usual)?;
    let count = steps.iter().filter(|step| **step > usual).count();
    let name = |i: usize| files[i].file_name().unwrap_or_default().to_string_lossy().into_owned();
    Some(format!(
        "pictures are missing by their numbers, in {} (first: {} is followed by {}): the times of later ones are too \
         early",
        text::count(count, "place"),
        name(first),
        name(first + 1)
    ))
}

/// Orders names so that `f2` comes before `f10`.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a.as_bytes(), b.as_bytes());
    loop {
        let (i, j) = (digits(left), digits(right));
        if i > 0 && j > 0 {
            let value = |number: &[u8]| number.iter().position(|c| *c != b'0').unwrap_or(number.len());
            let (x, y) = (&left[value(&left[..i])..i], &right[value(&right[..j])..j]);
            match x.len().cmp(&y.len()).then_with(|| x.cmp(y)) {
                Ordering::Equal => (left, right) = (&left[i..], &right[j..]),
                unequal => return unequal,
            }
            continue;
        }
        match (left.split_first(), right.split_first()) {
            (Some((x, rest_left)), Some((y, rest_right))) if x == y => (left, right) = (rest_left, rest_right),
            // `007` and `7` are distinguished by their text.
            (None, None) => return a.cmp(b),
            (x, y) => return x.map(|x| x.0).cmp(&y.map(|y| y.0)),
        }
    }
}

fn digits(text: &[u8]) -> usize {
    text.iter().take_while(|c| c.is_ascii_digit()).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn list() -> &'static Path {
        Path::new("rgb.txt")
    }

    #[test]
    fn picture_list_is_read_by_time() {
        let read = parse_pictures("# timestamp filename\n1.5 rgb/a b.png\n\n2.5 rgb/c.png\n", list()).unwrap();
        assert_eq!(read, [(1.5, "rgb/a b.png".to_owned()), (2.5, "rgb/c.png".to_owned())]);
        for (bad, said) in [
            ("2 a.png\n1 b.png", "rgb.txt, line 2: the time runs backwards: 1 after 2"),
            ("2 a.png\nnan b.png", "rgb.txt, line 2: timestamp is `nan`"),
            ("2 a.png\n\n3", "rgb.txt, line 3: the file's name is missing"),
        ] {
            let error = parse_pictures(bad, list()).unwrap_err().to_string();
            assert!(error.starts_with(said), "{error}");
        }
    }

    #[test]
    fn frame_opacity_is_read_and_checked() {
        let read = |text: &str| frames(text, Path::new("site/frames.txt"));
        let file = |name: &str| Path::new("site").join(name);
        let listing = read("1 f/a b.png\n2 f/c.png opacity=0.25\n3 opacity=0.5 opacity=1\n").unwrap();
        let expected = [(1.0, file("f/a b.png"), 1.0), (2.0, file("f/c.png"), 0.25), (3.0, file("opacity=0.5"), 1.0)];
        assert_eq!(listing, expected);
        assert_eq!(read("1 a.png presence=0.25\n").unwrap(), [(1.0, file("a.png"), 0.25)], "the earlier name");
        for (bad, quoted) in [("-0.1", "-0.1"), ("1.5", "1.5"), ("nan", "nan"), ("", ""), ("0.5 x", "0.5 x")] {
            let error = read(&format!("1 a.png\n2 b.png opacity={bad}")).unwrap_err().to_string();
            let message = format!("frames.txt, line 2: opacity is `{quoted}`; expected a number from 0 to 1");
            assert!(error.ends_with(&message), "{error}");
        }
        assert!(read("1  opacity=0.5").unwrap_err().to_string().contains("the file's name is missing"));
    }

    #[test]
    fn exposure_list_is_read_by_time() {
        let read = parse_exposures("1 0.02 1.5\n2 0.01\n", list()).unwrap();
        assert_eq!(read[0].1, FrameExposure { time_s: Some(0.02), gain: Some(1.5), ..Default::default() });
        assert_eq!(read[1].1, FrameExposure { time_s: Some(0.01), ..Default::default() });
        for bad in ["1 0", "1 -0.1", "1 60.1", "1 1e39", "1 0.1 0", "1 0.1 1 2", "1", "1 0.1 inf", "1 0.1 1e7"] {
            assert!(parse_exposures(bad, list()).is_err(), "{bad}");
        }
        let error = parse_exposures("1 60\n2 1e39", list()).unwrap_err().to_string();
        assert!(error.contains("line 2") && error.contains("above 0, at most 60"), "{error}");
    }

    #[test]
    fn names_that_break_a_line_are_refused() {
        for name in ["", " a", "a ", "a\nb", "a\rb", "a opacity=1", "a presence=1"] {
            assert!(write_pictures([(1.0, name)]).is_err(), "{name:?}");
        }
    }

    #[test]
    fn nearest_entry_respects_the_reach() {
        let entries = [(1.0, 'a'), (2.0, 'b'), (2.6, 'c')];
        assert_eq!(nearest(&entries, 2.31, 0.6).unwrap().1, 'c');
        assert_eq!(nearest(&entries, 2.29, 0.6).unwrap().1, 'b');
        assert_eq!(nearest(&entries, 0.5, 0.6).unwrap().1, 'a');
        assert!(nearest(&entries, 0.3, 0.6).is_none());
        assert!(nearest(&entries, 3.3, 0.6).is_none());
        assert!(nearest::<char>(&[], 1.0, 0.6).is_none());
    }

    #[test]
    fn natural_order_compares_numbers_by_value() {
        let mut names = ["f10.png", "f9.png", "f009.png", "f1.png", "e11", "f1", "g1305031241.029623"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["e11", "f1", "f1.png", "f009.png", "f9.png", "f10.png", "g1305031241.029623"]);
    }

    #[test]
    fn missing_numbers_are_reported() {
        let missing = |names: &[&str]| missing_numbers(&names.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(missing(&["r/f_08.png", "r/f_09.png", "r/f_10.png"]), None);
        assert_eq!(missing(&["0.jpg", "10.jpg", "20.jpg"]), None, "every tenth");
        for other in [&["a1.png", "b7.png", "b8.png"][..], &["door.png", "wall.png"], &["1.png"], &[]] {
            assert_eq!(missing(other), None);
        }
        let text = missing(&["f_1.png", "f_2.png", "f_3.png", "f_5.png", "f_6.png", "f_9.png"]).unwrap();
        assert!(text.contains("in 2 places (first: f_3.png is followed by f_5.png)"), "{text}");
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in "\\PC*", near in "([-0-9.eNa]{0,5}[ \n]){0,30}") {
            for text in [text, near] {
                let _ = parse_pictures(&text, list());
                let _ = frames(&text, list());
                let _ = parse_exposures(&text, list());
            }
        }

        #[test]
        fn written_list_reads_back_equal(
            rows in prop::collection::vec((any::<f64>(), "[!-~é][ -~é]{0,8}[!-~é]", 1e-9..60.0f64, prop::option::of(1e-6..1e6f64)), 0..9)
        ) {
            let mut rows: Vec<_> = rows.into_iter().filter(|row| row.0.is_finite()).collect();
            rows.sort_by(|a, b| a.0.total_cmp(&b.0));
            let pictures: Vec<_> = rows.iter().map(|row| (row.0, row.1.clone())).collect();
            let text = write_pictures(pictures.iter().map(|(t, name)| (*t, name.as_str()))).unwrap();
            prop_assert_eq!(format!("{:?}", parse_pictures(&text, list()).unwrap()), format!("{pictures:?}"));
            let listed: Vec<_> = rows.iter().map(|row| (row.0, row.1.as_str(), row.2 / 60.0)).collect();
            let text = write_frames(listed.iter().copied()).unwrap();
            let expected: Vec<_> = listed.iter().map(|(t, name, share)| (*t, PathBuf::from(name), *share)).collect();
            prop_assert_eq!(format!("{:?}", frames(&text, Path::new("f.txt")).unwrap()), format!("{expected:?}"));
            let exposures = rows.iter().map(|(t, _, time_s, gain)| {
                (*t, FrameExposure { time_s: Some(*time_s), gain: *gain, ..FrameExposure::default() })
            });
            let exposures: Vec<_> = exposures.collect();
            let read = parse_exposures(&write_exposures(&exposures), list()).unwrap();
            prop_assert_eq!(format!("{read:?}"), format!("{exposures:?}"));
        }

        #[test]
        fn natural_order_is_total(a in "[a01.]{0,6}", b in "[a01.]{0,6}", c in "[a01.]{0,6}") {
            prop_assert_eq!(natural_order(&a, &b), natural_order(&b, &a).reverse());
            prop_assert_eq!(natural_order(&a, &b) == Ordering::Equal, a == b);
            if natural_order(&a, &b).is_le() && natural_order(&b, &c).is_le() {
                prop_assert!(natural_order(&a, &c).is_le());
            }
        }
    }
}
