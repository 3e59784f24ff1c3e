//! Detects coordinate systems of LAS files with a unit other than the metre.
//!
//! The system is given as text (OGC WKT) or as a list of GeoTIFF keys (LAS 1.4 R15; OGC GeoTIFF
//! 1.1). Feet and degrees in either cause a warning. A bare EPSG code does not: its unit is only in
//! the EPSG registry.

use super::las_header::LasRecord;

const PROJECTION_USER: &[u8] = b"LASF_Projection";
/// Record IDs of WKT, of GeoTIFF keys, and of their texts.
const WKT: u16 = 2112;
const GEO_KEYS: u16 = 34735;
const GEO_TEXTS: u16 = 34737;
/// GeoTIFF keys: the kind of system, and the units of lengths along the ground and upwards.
const MODEL_KEY: u16 = 1024;
const LENGTH_UNIT_KEYS: [u16; 2] = [3076, 4099];
const GEOGRAPHIC_MODEL: u16 = 2;
/// Codes of EPSG for the metre, the international foot and the US survey foot.
const METRE: u16 = 9001;
const FEET: [u16; 2] = [9002, 9003];

const FEET_WARNING: &str = "the file's coordinate system is in feet, not in metres as assumed here: 1 unit is about \
                            0.3048 m; set the unit, or export the scan in metres";
const DEGREES_WARNING: &str = "the file's coordinates are degrees of longitude and latitude, which cannot be placed; \
                               export the scan in a projected system in metres, such as UTM";

/// Warnings about the unit of a file with these records.
pub(super) fn unit_warnings(records: &[LasRecord]) -> Vec<String> {
    let mut names_feet = false;
    let mut names_degrees = false;
    let mut other_units = Vec::new();
    for LasRecord { number, data, .. } in records.iter().filter(|record| record.user == PROJECTION_USER) {
        let text = String::from_utf8_lossy(data).to_lowercase();
        match *number {
            WKT => {
                names_feet |= has_feet(&text);
                names_degrees |= ["geogcs[", "geogcrs["].iter().any(|start| text.trim_start().starts_with(start));
            }
            GEO_TEXTS => names_feet |= has_feet(&text),
            GEO_KEYS => {
                for (key, value) in keys(data) {
                    names_degrees |= key == MODEL_KEY && value == GEOGRAPHIC_MODEL;
                    let is_unit = LENGTH_UNIT_KEYS.contains(&key);
                    names_feet |= is_unit && FEET.contains(&value);
                    if is_unit && value != METRE && !FEET.contains(&value) {
                        other_units.push(value);
                    }
                }
            }
            _ => {}
        }
    }
    let other = other_units.first().map(|code| {
        format!("the file's coordinate system has the unit EPSG:{code}, not metres as assumed here; check the scale")
    });
    let feet = names_feet.then(|| FEET_WARNING.to_owned());
    let degrees = names_degrees.then(|| DEGREES_WARNING.to_owned());
    feet.into_iter().chain(degrees).chain(other).collect()
}

/// True if a text has a foot as a word: "Foot_US", "US survey foot", "ftUS".
fn has_feet(text: &str) -> bool {
    text.split(|c: char| !c.is_ascii_alphabetic()).any(|word| matches!(word, "foot" | "feet" | "ft" | "ftus"))
}

/// GeoTIFF keys that store their value inline.
fn keys(data: &[u8]) -> impl Iterator<Item = (u16, u16)> {
    let number = |entry: &[u8], n: usize| u16::from_le_bytes([entry[2 * n], entry[2 * n + 1]]);
    // The first entry is the directory's header.
    let entries = data.chunks_exact(8).skip(1);
    entries.filter(move |entry| number(entry, 1) == 0).map(move |entry| (number(entry, 0), number(entry, 3)))
}

#[cfg(test)]
mod tests {
    use super::super::test_data::las_file as written;
    use super::super::test_data::read_bytes;

    fn warnings(number: u16, data: &[u8]) -> Vec<String> {
        read_bytes("a.las", &written(&[("LASF_Projection", number, data)], &[[0; 3]])).unwrap().warnings
    }

    #[test]
    fn feet_and_degrees_are_warned_of_and_metres_not() {
        let keys = |entries: &[[u16; 4]]| -> Vec<u8> {
            [[1, 1, 0, entries.len() as u16]].iter().chain(entries).flatten().flat_map(|n| n.to_le_bytes()).collect()
        };
        for (number, data, said) in [
            (2112, b"PROJCS[\"NAD83 / Texas\",UNIT[\"US survey foot\",0.3048006]]".to_vec(), Some("in feet")),
            (2112, b"PROJCS[\"UTM 32N\",GEOGCS[\"WGS 84\"],UNIT[\"metre\",1]]".to_vec(), None),
            (2112, b"GEOGCS[\"WGS 84\",UNIT[\"degree\",0.0174]]".to_vec(), Some("degrees")),
            (34735, keys(&[[1024, 0, 1, 1], [3076, 0, 1, 9003]]), Some("in feet")),
            (34735, keys(&[[1024, 0, 1, 1], [3076, 0, 1, 9001], [4099, 0, 1, 9002]]), Some("in feet")),
            (34735, keys(&[[1024, 0, 1, 1], [3076, 0, 1, 9001]]), None),
            (34735, keys(&[[1024, 0, 1, 2]]), Some("degrees")),
            (34735, keys(&[[3076, 0, 1, 9005]]), Some("EPSG:9005")),
            (34735, vec![1, 2, 3], None),
            (34737, b"NAD83 / California zone 5 (ftUS)|".to_vec(), Some("in feet")),
            (34737, b"Swift after Lefoote|".to_vec(), None),
        ] {
            let warnings = warnings(number, &data);
            let matches = said.is_none_or(|said| warnings.len() == 1 && warnings[0].contains(said));
            assert!(matches && warnings.is_empty() == said.is_none(), "{number} {said:?}: {warnings:?}");
        }
    }
}
