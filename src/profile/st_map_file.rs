//! ST maps that a profile names as its camera's lens, in `[camera.distortion]`: `undistort` makes
//! the undistorted picture of the recorded one, `redistort` the recorded one of the undistorted.
//! Either is enough; both are fitted together.

use std::path::{Path, PathBuf};

use super::st_samples::{Direction, samples};
use crate::camera::{Distortion, FitError, LensMap, fit_lens_map};
use crate::params::{Field, Kind, Params, Value};
use crate::source::st_map::{self, StPicture};

/// Keys that name the files.
const UNDISTORT: &str = "undistort";
const REDISTORT: &str = "redistort";
/// Keys of the undistorted picture's size, for `redistort` alone. The recorded picture's without
/// them.
const SIZE: [&str; 2] = ["undistorted_width_px", "undistorted_height_px"];
/// Largest side of the undistorted picture, px.
const MAX_SIDE_PX: i64 = 65_536;

/// Largest ratio of the scales across and down in the middle of `redistort` alone, if the size of
/// the undistorted picture is not stated.
const MAX_SCALE_RATIO: f64 = 1.02;

/// A map of a profile and its file.
struct MapFile {
    key: &'static str,
    path: PathBuf,
    picture: StPicture,
}

/// Replaces the keys of ST maps in the table `camera.distortion` by the fitted lens. `profile` is
/// the profile's file, to which the paths are relative; `None` removes the keys only.
pub fn resolve(entries: &mut toml::Table, profile: Option<&Path>) -> Result<(), String> {
    let names = [UNDISTORT, REDISTORT].map(|key| entries.remove(key).map(|value| (key, value)));
    let size = SIZE.map(|key| entries.remove(key).map(|value| (key, value)));
    let Some(profile) = profile else { return Ok(()) };
    let [undistort, redistort] =
        names.map(|entry| entry.map(|(key, name)| MapFile::read(key, &name, profile)).transpose());
    let (undistort, redistort) = (undistort?, redistort?);
    let size = stated_size(size)?;
    if undistort.is_none() && redistort.is_none() {
        return match size {
            Some(_) => Err(format!("[camera.distortion] {} belongs to `{REDISTORT}`, which is missing", SIZE[0])),
            None => Ok(()),
        };
    }
    if entries.get("model").is_some_and(|model| model.as_str() != Some("st_map")) || entries.contains_key("map") {
        return Err(format!(
            "[camera.distortion] has an ST map (`{UNDISTORT}`, `{REDISTORT}`) and another lens; expected one of them: \
             model = \"st_map\""
        ));
    }
    insert(&lens(undistort.as_ref(), redistort.as_ref(), size)?, entries);
    Ok(())
}

/// Puts a lens into the table, in place of the coefficients of profiles that were read before.
fn insert(map: &LensMap, entries: &mut toml::Table) {
    for spec in Distortion::default().specs() {
        if matches!(spec.kind, Kind::Number { .. }) {
            entries.entry(spec.name).or_insert(toml::Value::Float(0.0));
        }
    }
    if let Value::Text(text) = map.to_value() {
        entries.insert("map".to_owned(), toml::Value::String(text));
    }
    entries.insert("model".to_owned(), toml::Value::String("st_map".to_owned()));
}

impl MapFile {
    fn read(key: &'static str, name: &toml::Value, profile: &Path) -> Result<Self, String> {
        let name = name.as_str().ok_or_else(|| format!("[camera.distortion] {key} must name a file"))?;
        let path = profile.with_file_name(name);
        let picture = st_map::read(&path).map_err(|error| format!("[camera.distortion] {key}: {error}"))?;
        Ok(Self { key, path, picture })
    }

    /// Refuses a map `redistort` that seems to lead to an undistorted picture of another size than
    /// the recorded one's: its places are fractions of that size.
    fn check_unstated_size(&self) -> Result<(), String> {
        let StPicture { width, height, size_px, ref st, .. } = self.picture;
        // Half the distance of the compared pixels from each other.
        let [dx, dy] = [width, height].map(|side| (side / 32).max(1));
        let (x, y) = (width / 2, height / 2);
        let value = |x: usize, y: usize, channel: usize| {
            st.get(y * width + x).filter(|_| x < width).map_or(f64::NAN, |st| f64::from(st[channel]))
        };
        let step = (value(x + dx, y, 0) - value(x.saturating_sub(dx), y, 0)).abs() / (2 * dx) as f64;
        let scale_x = f64::from(size_px[0]) * step;
        let step = (value(x, y + dy, 1) - value(x, y.saturating_sub(dy), 1)).abs() / (2 * dy) as f64;
        let scale_y = f64::from(size_px[1]) * step;
        if (scale_x / scale_y).max(scale_y / scale_x) > MAX_SCALE_RATIO {
            return Err(self.failed(format!(
                "scales the middle of the picture by {scale_x:.3} across and {scale_y:.3} down, as if its undistorted \
                 picture were not of {}x{} px: state the size as {} and {}",
                size_px[0], size_px[1], SIZE[0], SIZE[1]
            )));
        }
        Ok(())
    }

    fn failed(&self, problem: impl std::fmt::Display) -> String {
        format!("[camera.distortion] {}: {}: the ST map {problem}", self.key, self.path.display())
    }
}

fn stated_size(size: [Option<(&'static str, toml::Value)>; 2]) -> Result<Option<[u32; 2]>, String> {
    let side = |entry: Option<(&'static str, toml::Value)>| match entry {
        Some((_, toml::Value::Integer(side))) if (1..=MAX_SIDE_PX).contains(&side) => Ok(Some(side as u32)),
        Some((key, other)) => Err(format!("[camera.distortion] {key} = {other}; expected 1 to {MAX_SIDE_PX} px")),
        None => Ok(None),
    };
    let [width, height] = size.map(side);
    match (width?, height?) {
        (Some(width), Some(height)) => Ok(Some([width, height])),
        (None, None) => Ok(None),
        _ => Err(format!("[camera.distortion] expected both {} and {}, or neither", SIZE[0], SIZE[1])),
    }
}

/// The lens of the maps.
fn lens(undistort: Option<&MapFile>, redistort: Option<&MapFile>, size: Option<[u32; 2]>) -> Result<LensMap, String> {
    let own_px = undistort.map(|map| map.picture.size_px);
    if let (Some(map), Some([width, height]), Some(stated)) = (undistort, own_px, size)
        && [width, height] != stated
    {
        return Err(map.failed(format!("is {width}x{height} px, not {}x{} as stated", stated[0], stated[1])));
    }
    let recorded_px = redistort.map(|map| map.picture.size_px);
    let undistorted_px = own_px.or(size).or(recorded_px).unwrap_or([1; 2]);
    let pairs = |map: Option<&MapFile>, direction| match map {
        Some(map) => samples(&map.picture, direction, undistorted_px).map_err(|problem| map.failed(problem)),
        None => Ok(Vec::new()),
    };
    let forward = pairs(undistort, Direction::Undistort)?;
    let back = pairs(redistort, Direction::Redistort)?;
    if let (None, Some(map), None) = (undistort, redistort, size) {
        map.check_unstated_size()?;
    }
    let fit = |pairs: &[_]| fit_lens_map(pairs, undistorted_px, recorded_px);
    let Some(map) = undistort.or(redistort) else { return Err(format!("[camera.distortion] {UNDISTORT} is missing")) };
    fit(&[forward.as_slice(), &back].concat()).map_err(|error| match error {
        FitError::Rough { .. } if fit(&forward).is_ok() && fit(&back).is_ok() => map.failed(
            "and the one of the other direction do not invert each other: write both from the same lens, with the same \
             focal length",
        ),
        error => map.failed(error),
    })
}

#[cfg(test)]
mod tests;
