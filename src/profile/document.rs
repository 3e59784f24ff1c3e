//! Profiles as editable text: comments and layout are preserved.

use std::fmt;
use std::path::Path;

use toml_edit::{DocumentMut, Item, Table, TableLike};

use super::{ProfileError, Rig, noise};
use crate::camera::{Geometry, NoiseProfile};
use crate::compositor::ON;
use crate::document::{self, Problem, merge, table_of};
use crate::params::Params;

const NOISE_TABLE: &str = "camera.noise";
/// Prefix of the origin comment above a noise table.
const NOISE_SIGNATURE: &str = "# By `locard calibrate noise";
/// Prefix of the origin comment above a camera's intrinsics.
const LENS_SIGNATURE: &str = "# By `locard calibrate camera";
/// Prefix of the further lines of such a comment.
const CONTINUATION_PREFIX: &str = "#    ";
/// Keys of `[camera]` that a lens calibration replaces.
const GEOMETRY_KEYS: [&str; 6] = ["width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px"];

/// A profile, with the comments, spacing and order of its text.
#[derive(Clone, Debug)]
pub struct ProfileFile {
    text: DocumentMut,
}

impl ProfileFile {
    /// An empty profile, with `heading` as a comment at the top.
    pub fn new(heading: &str) -> Self {
        let mut text = DocumentMut::new();
        text.insert("version", toml_edit::value(1));
        if let (Some(mut key), false) = (text.key_mut("version"), heading.is_empty()) {
            key.leaf_decor_mut().set_prefix(heading.lines().map(|line| format!("# {line}\n")).collect::<String>());
        }
        Self { text }
    }

    /// Parses the text of a profile; `path` is for error messages. Other files, such as a
    /// recording's or a scene's, are refused. A noise example that it names need not exist.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ProfileError> {
        Rig::check_text(text, path)?;
        let failed = |source: Problem| ProfileError::Syntax { path: path.to_owned(), source };
        Ok(Self { text: document::edited(text).map_err(failed)? })
    }

    /// True if there is a noise table.
    pub fn has_noise(&self) -> bool {
        self.text.get("camera").and_then(|camera| camera.get("noise")).is_some()
    }

    /// Replaces the camera's noise. `origin` becomes a comment above it, as in "by `locard
    /// calibrate noise`, from 20 frames", and replaces an earlier such comment. Empty for none.
    /// `file`: the file to which the profile is written; the path of a noise example is relative to
    /// it.
    pub fn set_noise(&mut self, profile: &NoiseProfile, origin: &str, file: &Path) {
        self.put(NOISE_TABLE, &noise::to_toml(profile, file));
        self.sign(NOISE_TABLE, NOISE_SIGNATURE, origin);
    }

    /// Replaces size, focal lengths, principal point and distortion; the camera's other keys are
    /// kept. `origin` as for [`ProfileFile::set_noise`], above the camera's table; its further
    /// lines become comments too.
    pub fn set_geometry(&mut self, geometry: &Geometry, origin: &str) {
        self.set_estimated_geometry(geometry);
        self.sign("camera", LENS_SIGNATURE, origin);
    }

    /// Like [`ProfileFile::set_geometry`], for a geometry that is not calibrated: without its
    /// comment.
    pub fn set_estimated_geometry(&mut self, geometry: &Geometry) {
        for name in GEOMETRY_KEYS {
            self.set_param(&geometry.intrinsics, name);
        }
        self.set_params(&geometry.distortion);
    }

    /// Puts a comment above a table, replacing one with the same prefix.
    fn sign(&mut self, name: &str, signature: &str, origin: &str) {
        let Some(decor) = table_at(&mut self.text, name).map(Table::decor_mut) else { return };
        let before = decor.prefix().and_then(|prefix| prefix.as_str()).unwrap_or("\n");
        let mut kept = String::new();
        let mut is_ours = false;
        for line in before.split_inclusive('\n') {
            // Continuation lines of the comment are indented.
            is_ours = line.starts_with(signature) || (is_ours && line.starts_with(CONTINUATION_PREFIX));
            kept += if is_ours { "" } else { line };
        }
        let mut lines = origin.lines();
        kept.extend(lines.next().map(|first| format!("{signature}{first}\n")));
        kept.extend(lines.map(|line| format!("{CONTINUATION_PREFIX}{line}\n")));
        decor.set_prefix(kept);
    }

    /// Adapts the path of a noise example to a profile that was read from one file and is written
    /// to another.
    pub fn relocate(&mut self, from: &Path, to: &Path) {
        // `Item::get_mut` inserts missing keys, a table's does not.
        let camera = self.text.get_mut("camera").and_then(Item::as_table_like_mut);
        let noise = camera.and_then(|camera| camera.get_mut("noise")).and_then(Item::as_table_like_mut);
        let Some(item) = noise.and_then(|noise| noise.get_mut(noise::EXAMPLE)) else { return };
        let Some(name) = item.as_str().map(str::to_owned) else { return };
        let folder = |path: &Path| std::path::absolute(path).ok().and_then(|path| Some(path.parent()?.to_owned()));
        let (Some(value), true) = (item.as_value_mut(), folder(from) != folder(to)) else { return };
        let mut name = noise::example_name(&from.with_file_name(name), to);
        *name.decor_mut() = value.decor().clone();
        *value = name;
    }

    /// Removes the camera's noise.
    pub fn remove_noise(&mut self) {
        if let Some(camera) = self.text.get_mut("camera").and_then(Item::as_table_like_mut) {
            camera.remove("noise");
        }
    }

    /// Replaces a table of parameters. Parameters without a value are omitted.
    pub fn set_params(&mut self, params: &dyn Params) {
        self.put(params.table(), &table_of(params));
    }

    /// Sets one parameter and keeps the table's other keys;
    /// [`Value::None`](crate::params::Value::None) removes it.
    pub fn set_param(&mut self, params: &dyn Params, name: &str) {
        self.set_key(params.table(), name, table_of(params).remove(name));
    }

    /// The number of a parameter in the text; `None` if it is missing or no number.
    pub fn number(&self, table: &str, name: &str) -> Option<f64> {
        let mut tables = table.split('.');
        let first = self.text.get(tables.next()?)?;
        let value = tables.try_fold(first, |item, part| item.get(part))?.get(name)?;
        value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
    }

    /// Sets one parameter to a number within its range, and keeps the table's other keys.
    pub fn set_number(&mut self, table: &str, name: &str, to: f64) {
        self.set_key(table, name, Some(Item::Value(document::number(to))));
    }

    /// Enables or disables an effect in its table.
    pub fn switch(&mut self, effect: &str, on: bool) {
        self.set_key(effect, ON, Some(toml_edit::value(on)));
    }

    fn set_key(&mut self, table: &str, key: &str, to: Option<Item>) {
        let own = table_at(&mut self.text, table).into_iter().flat_map(|table| table.iter());
        let own = own.filter(|(_, item)| !item.is_table_like());
        let mut keys: Table = own.map(|(key, item)| (key, item.clone())).collect();
        match to {
            Some(item) => _ = keys.insert(key, item),
            None => _ = keys.remove(key),
        }
        self.put(table, &keys);
    }

    /// Sets the keys of the named table, such as `camera.noise`, except for its subtables.
    fn put(&mut self, name: &str, table: &Table) {
        let mut at: &mut dyn TableLike = self.text.as_table_mut();
        for part in name.split('.') {
            let mut new = Table::new();
            new.set_implicit(true);
            let item = at.entry(part).or_insert(Item::Table(new));
            if !item.is_table_like() {
                *item = Item::Table(Table::new());
            }
            let Some(inner) = item.as_table_like_mut() else { return };
            at = inner;
        }
        // Subtables are left unchanged.
        let mine: Table = at.iter().filter(|(_, item)| !item.is_table_like()).map(|(k, v)| (k, v.clone())).collect();
        merge(at, Some(&mine), table);
        if let Some(table) = table_at(&mut self.text, name) {
            table.set_implicit(false);
        }
    }
}

fn table_at<'a>(text: &'a mut DocumentMut, name: &str) -> Option<&'a mut Table> {
    name.split('.').try_fold(text.as_table_mut(), |table, part| table.get_mut(part)?.as_table_mut())
}

impl fmt::Display for ProfileFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.text.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{CameraExposure, Intrinsics, NoiseBin};
    use crate::compositor::Settings;
    use crate::params;
    use proptest::prelude::*;

    const PROFILE: &str = "# mine\nversion = 1 # the only one\n\n[camera]   # a Kinect\nfx_px = 5.250e2\n\n\
        # measured in May\n[camera.noise]\ncode = [0.0] # old\nsigma_r = [1]\nsigma_g = [1]\nsigma_b = [1]\n\
        channel_correlation = [0, 0, 0]\nneighbour_correlation = [0, 0] # none\n\n[noise]\nscale = 1.50  # more\n";

    fn noise() -> NoiseProfile {
        let bins = [8.0, 24.5].map(|code| NoiseBin { code, sigma: 2.25 }).to_vec();
        let bins = [bins.clone(), bins.clone(), bins];
        NoiseProfile { example: None, bins, channel_correlation: [0.5, 0.25, 0.5], neighbour_correlation: [0.0, 0.125] }
    }

    fn parse(text: &str) -> ProfileFile {
        ProfileFile::parse(text, Path::new("p.toml")).unwrap()
    }

    #[test]
    fn setting_a_parameter_preserves_everything_else() {
        let mut profile = parse(PROFILE);
        let mut settings = Settings::default();
        let mut set = |name: &str, value: params::Value| {
            settings.set("noise", name, &value).unwrap().unwrap();
            let tables = settings.tables();
            let noise = tables.iter().find(|table| table.table() == "noise").unwrap();
            profile.set_param(*noise, name);
            profile.to_string()
        };
        let text = set("scale", params::Value::Number(0.75));
        assert_eq!(text, PROFILE.replace("1.50", "0.75"));
        let text = set("iso", params::Value::Number(400.0));
        assert_eq!(text, PROFILE.replace("1.50  # more\n", "0.75  # more\niso = 400.0\n"));
        assert_eq!(set("iso", params::Value::None), PROFILE.replace("1.50", "0.75"));
        // A missing table.
        let exposure = CameraExposure { time_s: Some(0.5), ..CameraExposure::default() };
        profile.set_param(&exposure, "time_s");
        assert!(profile.to_string().contains("[camera.exposure]\ntime_s = 0.5\n"), "{profile}");
        assert!(!profile.to_string().contains("iso"));
    }

    #[test]
    fn disabled_effect_stays_disabled() {
        let read = |profile: &ProfileFile| {
            let mut settings = Settings::default();
            Rig::default().read_text(&profile.to_string(), Path::new("p.toml"), &mut settings).unwrap();
            settings
        };
        let mut profile = parse(PROFILE);
        profile.switch("noise", false);
        assert_eq!(profile.to_string(), PROFILE.replace("1.50  # more\n", "1.50  # more\non = false\n"));
        assert!(!read(&profile).is_on("noise") && read(&profile).is_on("motion_blur"));
        profile.switch("motion_blur", false);
        assert!(profile.to_string().ends_with("\n[motion_blur]\non = false\n"), "{profile}");
        assert!(!read(&profile).is_on("motion_blur"));
        profile.switch("noise", true);
        profile.switch("motion_blur", true);
        assert!(read(&profile) == read(&parse(PROFILE)));
    }

    #[test]
    fn setting_noise_replaces_only_the_noise() {
        let mut profile = parse(PROFILE);
        assert!(profile.has_noise());
        profile.set_noise(&noise(), "`, from 3 frames.", Path::new("p.toml"));
        let expected = PROFILE
            .replace("# measured in May\n", "# measured in May\n# By `locard calibrate noise`, from 3 frames.\n")
            .replace("[0.0] # old", "[8.0, 24.5] # old")
            .replace("= [1]", "= [2.25, 2.25]")
            .replace("[0, 0, 0]", "[0.5, 0.25, 0.5]")
            .replace("[0, 0] # none", "[0.0, 0.125] # none");
        assert_eq!(profile.to_string(), expected);
        profile.set_noise(&noise(), "`, from 4 frames.", Path::new("p.toml"));
        assert_eq!(profile.to_string(), expected.replace("3 frames", "4 frames"));

        let from = PROFILE.find("# measured").unwrap();
        let without = [&PROFILE[..from], &PROFILE[PROFILE.find("[noise]").unwrap()..]].concat();
        let mut profile = parse(&without);
        assert!(!profile.has_noise());
        profile.set_noise(&noise(), "", Path::new("p.toml"));
        let added = profile.to_string();
        assert!(added.contains("\n[camera.noise]\ncode = [8.0, 24.5]\nsigma_r = [2.25, 2.25]\n"), "{added}");
        for line in without.lines() {
            assert!(added.lines().any(|l| l == line), "{line} is gone:\n{added}");
        }
        assert_eq!(parse(&added).to_string(), added);
    }

    #[test]
    fn new_profile_has_heading_version_and_contents() {
        let mut profile = ProfileFile::new("The first.\nThe second.");
        profile.set_noise(&noise(), "", Path::new("p.toml"));
        let text = profile.to_string();
        let start = "# The first.\n# The second.\nversion = 1\n\n[camera.noise]\ncode = [8.0, 24.5]\n";
        assert!(text.starts_with(start), "{text}");
        profile.set_params(&Intrinsics { fx_px: 1e-9f64.max(0.1), ..Intrinsics::default() });
        let text = profile.to_string();
        assert!(text.contains("\n[camera]\nwidth_px = ") && text.contains("\nfx_px = 0.1\n"), "{text}");
        assert!(parse(&text).has_noise());
    }

    #[test]
    fn other_files_are_refused_as_profile() {
        for (text, message) in [
            ("version = 1\n[frames]\nlist = 'rgb.txt'\n", "there is no table [frames]"),
            ("version = 1\n[[objects]]\nmodel = 'a.glb'\n", "there is no table [objects]"),
            ("fx_px = 1\n", "`version` is missing"),
            ("version = 1\ncamera = 3\n", "there is no table [camera]"),
            ("version = 1\n[camera]\nfx_px = 1 1\n", "p.toml: line 3, camera.fx_px: "),
            ("# A page\n\nof text\n", "expected a profile (TOML)"),
        ] {
            let error = ProfileFile::parse(text, Path::new("p.toml")).unwrap_err().to_string();
            assert!(error.contains(message) && !error.contains('\n'), "{error}");
        }
    }

    proptest! {
        #[test]
        fn written_profile_reads_back_equal(
            codes in prop::collection::btree_set(0u32..2_000_000_000, 1..6),
            sigmas in prop::collection::vec(prop::array::uniform3(0.0..1e300f64), 6),
            correlation in -0.3..1.0f64,
            below in 0.0..1.0f64,
            time_s in 0.0..1.0f64,
            fx_px in 1.0..1e4f64,
        ) {
            let codes: Vec<f64> = codes.into_iter().map(|code| f64::from(code) * 255.0 / 2e9).collect();
            let bins = [0, 1, 2].map(|c| codes.iter().zip(&sigmas).map(|(&code, s)| NoiseBin { code, sigma: s[c] }).collect());
            let noise = NoiseProfile { example: None, bins, channel_correlation: [correlation; 3], neighbour_correlation: [0.0, below] };
            let intrinsics = Intrinsics { fx_px, ..Intrinsics::default() };
            let exposure = CameraExposure { time_s: Some(time_s), ..CameraExposure::default() };
            let mut profile = ProfileFile::new("");
            profile.set_params(&intrinsics);
            profile.set_params(&exposure);
            profile.set_noise(&noise, "", Path::new("p.toml"));
            let mut rig = Rig::default();
            rig.read_text(&profile.to_string(), Path::new("p.toml"), &mut Settings::default()).unwrap();
            // The shortest text of a number preserves every bit of it.
            prop_assert_eq!(format!("{:?}", rig.noise.unwrap()), format!("{noise:?}"));
            prop_assert_eq!(format!("{:?}", rig.intrinsics), format!("{intrinsics:?}"));
            prop_assert_eq!(rig.exposure, exposure);
        }
    }
}
