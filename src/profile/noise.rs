//! The table `[camera.noise]`: a calibration's results, as text and back.

use std::path::{Path, PathBuf};

use super::noise_model_file;
use crate::camera::{NoiseBin, NoiseProfile};
use crate::document::numbers as numbers_of;
use crate::example_noise::NoiseModelFile;
use crate::scene;
use crate::text::{count, number, quoted};
use toml::{Table, Value};

const SIGMAS: [&str; 3] = ["sigma_r", "sigma_g", "sigma_b"];
const KEYS: [&str; 6] = ["code", "sigma_r", "sigma_g", "sigma_b", "channel_correlation", "neighbour_correlation"];
/// Optional key: the file of the camera's noise by example, relative to the file with the table.
pub(super) const EXAMPLE: &str = "example";

/// Errors of a noise table.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum NoiseTableError {
    #[error("[camera.noise] has no key {key}; it needs {}", KEYS.join(", "))]
    Missing { key: &'static str },
    #[error("[camera.noise] has no key {actual}; its keys are {}, {EXAMPLE}", KEYS.join(", "))]
    Unknown { actual: String },
    #[error("[camera.noise] {key} = {actual}: expected a list of numbers")]
    NotNumbers { key: &'static str, actual: String },
    #[error("[camera.noise] {key} has {} where {expected} are expected ({why})", count(*actual, "value"))]
    Length { key: &'static str, actual: usize, expected: usize, why: &'static str },
    #[error("[camera.noise] code is empty; expected one code or more")]
    Empty,
    #[error("[camera.noise] {key}, value {place}: {}: expected {accepted}", number(*actual))]
    Value { key: &'static str, place: usize, actual: f64, accepted: &'static str },
    #[error(
        "[camera.noise] {EXAMPLE} = {actual}: expected the name of a file of `locard calibrate noise`, \
         relative to this file"
    )]
    ExampleName { actual: String },
    #[error("[camera.noise] {EXAMPLE}: {file}: {reason}")]
    Example { file: PathBuf, reason: String },
}

/// Handling of the key `example`.
#[derive(Clone, Copy, Debug)]
pub enum ExampleLoading<'a> {
    /// Reads the file. Its path is relative to the folder of this one.
    BesideFile(&'a Path),
    /// Leaves the example out. The key's type is checked all the same.
    Skip,
}

/// The noise table of a profile, for `file`. If channels were measured at different codes, each is
/// written at the codes of all.
pub fn to_toml(profile: &NoiseProfile, file: &Path) -> toml_edit::Table {
    let mut codes: Vec<f64> = profile.bins.iter().flatten().map(|b| b.code).collect();
    codes.sort_by(f64::total_cmp);
    codes.dedup();
    let sigma = |channel: usize| codes.iter().map(|&code| profile.sigma(channel, code)).collect();
    let lists = [codes.clone(), sigma(0), sigma(1), sigma(2)].into_iter();
    let lists = lists.chain([profile.channel_correlation.to_vec(), profile.neighbour_correlation.to_vec()]);
    let lists = KEYS.into_iter().zip(lists).map(|(key, list): (_, Vec<f64>)| (key, numbers_of(list)));
    let example = profile.example.as_ref().map(|example| (EXAMPLE, example_name(&example.file, file)));
    lists.chain(example).collect()
}

/// The value of [`EXAMPLE`] in `file`: a relative path, or an absolute one where none leads there.
pub(super) fn example_name(example: &Path, file: &Path) -> toml_edit::Value {
    scene::relative(example, file).into()
}

fn example(table: &Table, loading: ExampleLoading<'_>) -> Result<Option<NoiseModelFile>, NoiseTableError> {
    let Some(value) = table.get(EXAMPLE) else { return Ok(None) };
    let name = value.as_str().filter(|name| !name.is_empty());
    let name = name.ok_or_else(|| NoiseTableError::ExampleName { actual: quoted(&value.to_string()) })?;
    let ExampleLoading::BesideFile(beside) = loading else { return Ok(None) };
    let file = beside.with_file_name(name);
    let failed = |reason| NoiseTableError::Example { file: file.clone(), reason };
    noise_model_file::read(&file).map(Some).map_err(failed)
}

/// Reads and checks the table `[camera.noise]`.
pub fn from_toml(table: &Table, loading: ExampleLoading<'_>) -> Result<NoiseProfile, NoiseTableError> {
    if let Some(key) = table.keys().find(|k| !KEYS.contains(&k.as_str()) && *k != EXAMPLE) {
        return Err(NoiseTableError::Unknown { actual: quoted(key) });
    }
    let codes = numbers(table, "code", "an 8-bit code value, 0 to 255", |v| (0.0..=255.0).contains(&v))?;
    if codes.is_empty() {
        return Err(NoiseTableError::Empty);
    }
    if let Some(i) = (1..codes.len()).find(|&i| codes[i] <= codes[i - 1]) {
        let accepted = "more than the one before";
        return Err(NoiseTableError::Value { key: "code", place: i + 1, actual: codes[i], accepted });
    }
    let mut bins: [Vec<NoiseBin>; 3] = Default::default();
    for (bins, key) in bins.iter_mut().zip(SIGMAS) {
        let sigmas = numbers(table, key, "a standard deviation in 8-bit codes, 0 or more", |v| v >= 0.0)?;
        let why = "one for each code";
        check_length(key, sigmas.len(), codes.len(), why)?;
        *bins = codes.iter().zip(sigmas).map(|(&code, sigma)| NoiseBin { code, sigma }).collect();
    }
    let channel = numbers(table, "channel_correlation", "-1 to 1", |v| (-1.0..=1.0).contains(&v))?;
    let neighbour = numbers(table, "neighbour_correlation", "0 to 1", |v| (0.0..=1.0).contains(&v))?;
    let [rg, rb, gb] = fixed(&channel, "channel_correlation", "R-G, R-B, G-B")?;
    let neighbour_correlation = fixed(&neighbour, "neighbour_correlation", "to the right, below")?;
    if 1.0 + 2.0 * rg * rb * gb - rg * rg - rb * rb - gb * gb < -1e-3 {
        let accepted = "one that three channels can have together (1 + 2·rg·rb·gb ≥ rg² + rb² + gb²)";
        return Err(NoiseTableError::Value { key: "channel_correlation", place: 3, actual: gb, accepted });
    }
    let example = example(table, loading)?;
    Ok(NoiseProfile { example, bins, channel_correlation: [rg, rb, gb], neighbour_correlation })
}

fn numbers(
    table: &Table,
    key: &'static str,
    accepted: &'static str,
    accepts: impl Fn(f64) -> bool,
) -> Result<Vec<f64>, NoiseTableError> {
    let value = table.get(key).ok_or(NoiseTableError::Missing { key })?;
    let refused = || NoiseTableError::NotNumbers { key, actual: quoted(&value.to_string()) };
    let mut numbers = Vec::new();
    for (i, item) in value.as_array().ok_or_else(refused)?.iter().enumerate() {
        let number = match item {
            Value::Float(f) => *f,
            Value::Integer(n) => *n as f64,
            _ => return Err(refused()),
        };
        if !number.is_finite() || !accepts(number) {
            return Err(NoiseTableError::Value { key, place: i + 1, actual: number, accepted });
        }
        numbers.push(number);
    }
    Ok(numbers)
}

fn check_length(key: &'static str, length: usize, expected: usize, why: &'static str) -> Result<(), NoiseTableError> {
    if length == expected { Ok(()) } else { Err(NoiseTableError::Length { key, actual: length, expected, why }) }
}

fn fixed<const N: usize>(values: &[f64], key: &'static str, why: &'static str) -> Result<[f64; N], NoiseTableError> {
    values.try_into().map_err(|_| NoiseTableError::Length { key, actual: values.len(), expected: N, why })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GOOD: &str = "code = [8, 24.5]\nsigma_r = [1, 2]\nsigma_g = [1.0, 2.0]\nsigma_b = [0.0, 2.0]\n\
        channel_correlation = [0.1, -0.2, 0.3]\nneighbour_correlation = [0.5, 0]";

    fn parse(text: &str) -> Result<NoiseProfile, NoiseTableError> {
        from_toml(&text.parse().unwrap(), ExampleLoading::BesideFile(Path::new("p.toml")))
    }

    #[test]
    fn noise_table_reads_back_as_written() {
        let profile = parse(GOOD).unwrap();
        assert_eq!(profile.bins[0][1], NoiseBin { code: 24.5, sigma: 2.0 });
        assert_eq!(profile.bins[2][0].sigma, 0.0);
        assert_eq!((profile.channel_correlation, profile.neighbour_correlation), ([0.1, -0.2, 0.3], [0.5, 0.0]));
        assert_eq!(parse(&to_toml(&profile, Path::new("p.toml")).to_string()).unwrap(), profile);
    }

    #[test]
    fn noise_table_errors_name_the_key() {
        for (from, to, message) in [
            ("8, 24.5", "24.5, 8", "code, value 2: 8: expected more than the one before"),
            ("8, 24.5", "8, 256", "code, value 2: 256: expected"),
            ("code = [8, 24.5]", "code = []", "code is empty"),
            ("sigma_r = [1, 2]", "sigma_r = [1, -2]", "sigma_r, value 2: -2: expected"),
            ("sigma_r = [1, 2]", "sigma_r = [1, inf]", "sigma_r, value 2: inf"),
            ("sigma_r = [1, 2]", "sigma_r = [1, nan]", "sigma_r, value 2: NaN"),
            ("sigma_r = [1, 2]", "sigma_r = [1]", "sigma_r has 1 value where 2 are expected (one for each code)"),
            ("sigma_r = [1, 2]", "sigma_r = 'low'", "expected a list of numbers"),
            ("sigma_r = [1, 2]", "", "has no key sigma_r"),
            (
                "sigma_r",
                "sigma_x",
                "has no key sigma_x; its keys are code, sigma_r, sigma_g, sigma_b, channel_correlation, \
                neighbour_correlation, example",
            ),
            ("code =", "example = 3\ncode =", "example = 3: expected the name of a file"),
            ("code =", "example = ''\ncode =", "example = \"\": expected"),
            ("0.1, -0.2, 0.3", "0.1, -0.2", "channel_correlation has 2 values where 3"),
            ("0.1, -0.2, 0.3", "0.1, -0.2, 1.3", "value 3: 1.3: expected -1 to 1"),
            ("0.1, -0.2, 0.3", "0.9, 0.9, -0.9", "three channels can have together"),
            ("[0.5, 0]", "[0.5, -0.1]", "neighbour_correlation, value 2: -0.1: expected 0 to 1"),
        ] {
            let error = parse(&GOOD.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(message), "{error}\n{message}");
        }
    }

    #[test]
    fn channels_at_different_codes_keep_their_interpolation() {
        let bins = |list: &[(f64, f64)]| list.iter().map(|&(code, sigma)| NoiseBin { code, sigma }).collect::<Vec<_>>();
        let profile = NoiseProfile {
            example: None,
            bins: [bins(&[(0.0, 1.0), (100.0, 3.0)]), bins(&[(50.0, 4.0)]), bins(&[(0.0, 1.0), (200.0, 2.0)])],
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        let read = parse(&to_toml(&profile, Path::new("p.toml")).to_string()).unwrap();
        for c in 0..3 {
            for code in 0..256 {
                let code = f64::from(code);
                assert!((read.sigma(c, code) - profile.sigma(c, code)).abs() < 1e-12);
            }
        }
    }

    proptest! {
        #[test]
        fn arbitrary_noise_table_never_panics(
            codes in prop::collection::vec(prop_oneof![Just(f64::NAN), -10.0..300.0f64], 0..5),
            sigmas in prop::collection::vec(prop_oneof![Just(f64::INFINITY), -1.0..9.0f64], 0..5),
            pair in prop::collection::vec(-1.5..1.5f64, 0..4),
        ) {
            let list = |values: &[f64]| Value::Array(values.iter().map(|&v| Value::Float(v)).collect());
            let mut table = Table::new();
            table.insert("code".to_owned(), list(&codes));
            for key in SIGMAS {
                table.insert(key.to_owned(), list(&sigmas));
            }
            table.insert("channel_correlation".to_owned(), list(&pair));
            table.insert("neighbour_correlation".to_owned(), list(&pair[..pair.len().min(2)]));
            if let Ok(profile) = from_toml(&table, ExampleLoading::Skip) {
                prop_assert_eq!(parse(&to_toml(&profile, Path::new("p.toml")).to_string()).unwrap(), profile);
            }
        }
    }
}
