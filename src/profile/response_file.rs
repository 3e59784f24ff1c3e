//! Files of a response that a profile names: lines of code and light, or a one-dimensional lookup
//! table in Adobe's format (`.cube`, Cube LUT Specification 1.0) from code to light.

use std::path::Path;

use crate::camera::ResponseTable;
use crate::params::{Field, Value};
use crate::source::file::{self, MAX_DOCUMENT_BYTES};

/// Key in a profile's table `camera.response`: points, or the name of a file.
pub const TABLE: &str = "table";

/// The points of a value: as they are, or from the file of that name beside the profile.
pub fn points(value: &str, profile: &Path) -> Result<Value, String> {
    let path = profile.with_file_name(value);
    let looks_like_points = value.starts_with(|first: char| first.is_ascii_digit()) && value.contains([' ', ',', ';']);
    if looks_like_points && !path.is_file() {
        return ResponseTable::parse(value)
            .map(|table| table.to_value())
            .map_err(|problem| format!("[camera.response] table {problem}"));
    }
    let named = |problem: String| format!("[camera.response] table: {}: {problem}", path.display());
    let text = file::read_text(&path, MAX_DOCUMENT_BYTES).map_err(|e| named(crate::text::reason(&e)))?;
    parse(&text).map(|table| table.to_value()).map_err(named)
}

fn parse(text: &str) -> Result<ResponseTable, String> {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default().trim());
    let lines: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    if let Some(size) = lines.iter().find_map(|line| line.strip_prefix("LUT_1D_SIZE")) {
        return cube(&lines, size);
    }
    if lines.iter().any(|line| line.starts_with("LUT_3D_SIZE")) {
        return Err(
            "is a three-dimensional table; a response is the same for every colour: export a 1D table".to_owned()
        );
    }
    // A header of a CSV file is left out.
    let is_number = |line: &&&str| line.starts_with(|first: char| first.is_ascii_digit() || "+-.".contains(first));
    let pairs: Vec<String> = lines.iter().filter(is_number).map(|line| line.replace([',', ';', '\t'], " ")).collect();
    ResponseTable::parse(&pairs.join("\n"))
}

/// Entries at equidistant codes, one for each channel.
fn cube(lines: &[&str], size: &str) -> Result<ResponseTable, String> {
    let size: usize = size.trim().parse().map_err(|_| format!("its size is {}", crate::text::quoted(size.trim())))?;
    for line in lines {
        if line
            .strip_prefix("LUT_1D_INPUT_RANGE")
            .is_some_and(|range| range.split_whitespace().map(str::parse::<f64>).ne([Ok(0.0), Ok(1.0)]))
        {
            return Err("LUT_1D_INPUT_RANGE is not 0 1: codes are fractions of full scale".to_owned());
        }
        let expected = [("DOMAIN_MIN", 0.0), ("DOMAIN_MAX", 1.0)];
        let Some((key, bound)) = expected.into_iter().find(|(key, _)| line.starts_with(key)) else { continue };
        if line[key.len()..].split_whitespace().any(|number| number.parse() != Ok(bound)) {
            return Err(format!("{key} is not {bound}: codes are fractions of full scale"));
        }
    }
    let entry = |line: &&str| -> Option<[f64; 3]> {
        let numbers: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>().ok()?;
        numbers.try_into().ok()
    };
    let entries: Vec<[f64; 3]> = lines.iter().filter_map(entry).collect();
    if entries.len() != size || size < 2 {
        return Err(format!("has {} entries; its size is {size}", entries.len()));
    }
    if let Some(at) = entries.iter().position(|[r, g, b]| (r - g).abs().max((b - g).abs()) > 1e-5) {
        return Err(format!("differs between the channels at entry {at}; expected one response for all of them"));
    }
    let code = |entry: usize| entry as f64 / (size - 1) as f64;
    ResponseTable::new(entries.iter().enumerate().map(|(at, [_, light, _])| [code(at), *light]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_of_a_response_has_points_or_a_lookup_table() {
        let folder = tempfile::tempdir().unwrap();
        let profile = folder.path().join("camera.toml");
        let response_of = |text: &str| {
            std::fs::write(folder.path().join("r.csv"), text).unwrap();
            points("r.csv", &profile).map(|value| value.to_string())
        };
        let expected = "0 0, 0.5 0.2, 1 1";
        assert_eq!(response_of("code,light\n0,0\n0.5,0.2 # grey\n\n1,1\n").unwrap(), expected);
        let cube = "TITLE \"x\"\nLUT_1D_SIZE 3\nDOMAIN_MIN 0 0 0\nDOMAIN_MAX 1 1 1\n0 0 0\n.2 .2 .2\n1 1 1\n";
        assert_eq!(response_of(cube).unwrap(), expected);
        assert_eq!(points("0 0, 0.5 0.2; 1 1", &profile).unwrap().to_string(), expected);
        for (text, problem) in [
            ("LUT_3D_SIZE 2\n", "three-dimensional"),
            ("LUT_1D_SIZE 3\n0 0 0\n1 1 1\n", "has 2 entries; its size is 3"),
            ("LUT_1D_SIZE 2\n0 0 0\n1 0.5 1\n", "differs between the channels at entry 1"),
            ("LUT_1D_SIZE 2\nDOMAIN_MAX 2 2 2\n0 0 0\n1 1 1\n", "DOMAIN_MAX is not 1"),
            ("0 0\n0.5 0.5\n", "codes 0 to 0.5"),
            ("", "holds no points"),
        ] {
            let error = response_of(text).unwrap_err();
            assert!(error.contains("r.csv") && error.contains(problem), "{error}");
        }
        assert!(points("none.csv", &profile).unwrap_err().contains("none.csv"));
        assert!(points("0 0, 0.4 1", &profile).unwrap_err().contains("codes 0 to 0.4"));
    }
}
