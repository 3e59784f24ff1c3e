//! Parameters that a scene file sets for its shot: its `[settings]`, which has the tables of a
//! profile. They override the profile and an analysis; `--set` overrides them.

use std::collections::BTreeMap;
use std::path::Path;

use toml::{Table, Value as Toml};

use super::noise::{self, ExampleLoading};
use super::{ProfileError, Rig};
use crate::camera::NoiseProfile;
use crate::compositor::{ON, Settings, current_name};
use crate::params::{Kind, Params, Value};
use crate::text::quoted;

const NOISE: &str = "camera.noise";
/// Table and key whose value [`NONE`] removes the camera's noise.
const NO_NOISE: (&str, &str) = ("camera", "noise");
const LENS: &str = "camera.lens";
const OPENINGS: [&str; 2] = ["f_number", "aperture_diameter_mm"];
const TIME: &str = "time_s";
/// File value that removes a parameter set by the profile.
const NONE: &str = "none";

/// A camera and the effects' parameters, for comparison.
#[derive(Clone, Copy, Debug)]
pub struct ParameterValues<'a> {
    pub rig: &'a Rig,
    pub settings: &'a Settings,
}

impl<'a> ParameterValues<'a> {
    fn tables(self) -> Vec<&'a dyn Params> {
        self.rig.tables().into_iter().chain(self.settings.tables()).collect()
    }

    /// A parameter's value, or the state of an effect.
    fn value(self, table: &str, name: &str) -> Option<Value> {
        if name == ON {
            let mut effects = self.settings.effects();
            return effects.any(|effect| effect.table() == table).then(|| Value::Bool(self.settings.is_on(table)));
        }
        self.tables().into_iter().find(|params| params.table() == table)?.get(name)
    }
}

/// Values by table and name; the state of an effect has the name [`ON`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShotSettings {
    values: BTreeMap<(String, String), Value>,
    /// `Some(None)` removes the camera's noise.
    noise: Option<Option<NoiseProfile>>,
}

impl ShotSettings {
    /// Reads the table `[settings]`; `path` is named in errors. Names and ranges are checked by
    /// [`Self::apply`].
    pub fn read(table: &Table, path: &Path) -> Result<Self, ProfileError> {
        let mut read = Self::default();
        for (name, value) in table {
            match value {
                Toml::Table(inner) => read.read_table(name, inner, path)?,
                other => return Err(type_error(path, "settings", name, other)),
            }
        }
        Ok(read)
    }

    fn read_table(&mut self, table: &str, keys: &Table, path: &Path) -> Result<(), ProfileError> {
        if table == NOISE {
            let failed = |error: noise::NoiseTableError| ProfileError::Noise {
                path: path.to_owned(),
                message: error.to_string(),
            };
            self.noise = Some(Some(noise::from_toml(keys, ExampleLoading::BesideFile(path)).map_err(failed)?));
            return Ok(());
        }
        let opens = |name: &str| keys.get(name).is_some_and(|value| value.as_str() != Some(NONE));
        if table == LENS && OPENINGS.into_iter().all(opens) {
            return Err(ProfileError::TwoOpenings { path: path.to_owned() });
        }
        for (key, value) in keys {
            let value = match value {
                Toml::Table(inner) => {
                    self.read_table(&format!("{table}.{key}"), inner, path)?;
                    continue;
                }
                Toml::String(text) if text == NONE && (table, key.as_str()) == NO_NOISE => {
                    self.noise = Some(None);
                    continue;
                }
                Toml::Boolean(on) => Value::Bool(*on),
                Toml::Integer(number) => Value::Number(*number as f64),
                Toml::Float(number) => Value::Number(*number),
                Toml::String(text) if text == NONE => Value::None,
                Toml::String(text) => Value::Text(text.clone()),
                other => return Err(type_error(path, table, key, other)),
            };
            self.insert(table, key, value);
        }
        Ok(())
    }

    pub(super) fn insert(&mut self, table: &str, name: &str, value: Value) {
        self.values.insert((table.to_owned(), current_name(table, name).to_owned()), value);
    }

    pub(super) fn set_noise(&mut self, noise: NoiseProfile) {
        self.noise = Some(Some(noise));
    }

    /// The values that differ from `before` in `now`. An exposure that overrides that of each frame
    /// in `now` alone differs, even if its values are the same.
    pub fn between(before: ParameterValues<'_>, now: ParameterValues<'_>) -> Self {
        let mut settings = Self::default();
        for (old, new) in before.tables().into_iter().zip(now.tables()) {
            for spec in new.specs() {
                let value = new.get(spec.name).filter(|value| old.get(spec.name).as_ref() != Some(value));
                let key = (new.table().to_owned(), spec.name.to_owned());
                settings.values.extend(value.map(|value| (key, value)));
            }
        }
        for effect in now.settings.effects().map(|effect| effect.table()) {
            let on = now.settings.is_on(effect);
            if before.settings.is_on(effect) != on {
                settings.values.insert((effect.to_owned(), ON.to_owned()), Value::Bool(on));
            }
        }
        let exposure = now.rig.exposure.table();
        let overrides = now.settings.overrule_recorded_exposure && !before.settings.overrule_recorded_exposure;
        if overrides && !settings.values.keys().any(|(table, _)| table == exposure) {
            let time_s = now.value(exposure, TIME);
            settings.values.extend(time_s.map(|value| ((exposure.to_owned(), TIME.to_owned()), value)));
        }
        settings.noise = (before.rig.noise != now.rig.noise).then(|| now.rig.noise.clone());
        settings
    }

    /// Adds those values of `earlier` settings that are still in effect in `now`. They are kept
    /// even if they equal the values that they override.
    #[must_use]
    pub fn with_unchanged(mut self, earlier: &Self, now: ParameterValues<'_>) -> Self {
        if earlier.is_empty() {
            return self;
        }
        let (mut rig, mut settings) = (now.rig.clone(), now.settings.clone());
        // Refused values are not in effect.
        let _ = earlier.apply(&mut rig, &mut settings, Path::new(""));
        let applied = ParameterValues { rig: &rig, settings: &settings };
        for (table, name) in earlier.values.keys() {
            let value = now.value(table, name).filter(|value| applied.value(table, name).as_ref() == Some(value));
            self.values.extend(value.map(|value| ((table.clone(), name.clone()), value)));
        }
        if earlier.noise.as_ref() == Some(&now.rig.noise) {
            self.noise.clone_from(&earlier.noise);
        }
        self
    }

    /// Adds values of `others` for missing parameters. Only one of aperture diameter and f-number
    /// is given.
    #[must_use]
    pub fn or(mut self, others: &Self) -> Self {
        let is_opening = |(table, name): &(String, String)| table == LENS && OPENINGS.contains(&name.as_str());
        let is_open = self.values.iter().any(|(key, value)| is_opening(key) && *value != Value::None);
        for (key, value) in others.values.iter().filter(|(key, _)| !(is_open && is_opening(key))) {
            self.values.entry(key.clone()).or_insert_with(|| value.clone());
        }
        self.noise = self.noise.or_else(|| others.noise.clone());
        self
    }

    /// The subset that is not in effect in `now`, since other values override it. Noise is never in
    /// it.
    #[must_use]
    pub fn overridden(&self, now: ParameterValues<'_>) -> Self {
        let (mut rig, mut settings) = (now.rig.clone(), now.settings.clone());
        let _ = self.apply(&mut rig, &mut settings, Path::new(""));
        let applied = ParameterValues { rig: &rig, settings: &settings };
        let holds = |table: &str, name: &str| applied.value(table, name) == now.value(table, name);
        self.filtered(|table, name| !holds(table, name)).without_noise()
    }

    /// The subset with equal values in both. Noise is never in it.
    #[must_use]
    pub fn where_equal(&self, one: ParameterValues<'_>, other: ParameterValues<'_>) -> Self {
        self.filtered(|table, name| one.value(table, name) == other.value(table, name)).without_noise()
    }

    /// Applies the values; `path` is for error messages. An exposure overrides that of each frame,
    /// as `--set` does.
    pub fn apply(&self, rig: &mut Rig, settings: &mut Settings, path: &Path) -> Result<(), ProfileError> {
        let exposure = rig.exposure.table();
        // A value of aperture diameter or f-number replaces the other one, so those without a value
        // come first.
        let (without, with): (Vec<_>, Vec<_>) = self.values.iter().partition(|(_, value)| **value == Value::None);
        for ((table, name), value) in without.into_iter().chain(with) {
            settings.overrule_recorded_exposure |= table == exposure;
            let failed = |source| ProfileError::Param { path: path.to_owned(), source: Box::new(source) };
            match rig.set(settings, table, name, value) {
                Some(done) => done.map_err(failed)?,
                None => {
                    let tables = rig.known_tables(settings);
                    return Err(ProfileError::UnknownTable { path: path.to_owned(), table: quoted(table), tables });
                }
            }
        }
        if let Some(noise) = &self.noise {
            rig.noise.clone_from(noise);
        }
        Ok(())
    }

    /// True if a parameter is set.
    pub fn has(&self, table: &str, name: &str) -> bool {
        self.values.contains_key(&(table.to_owned(), name.to_owned()))
    }

    /// True if a parameter of a table is set.
    pub fn has_table(&self, table: &str) -> bool {
        self.values.keys().any(|(own, _)| own == table)
    }

    /// The camera's noise if set; `Some(None)` removes it.
    pub fn noise(&self) -> Option<Option<&NoiseProfile>> {
        self.noise.as_ref().map(Option::as_ref)
    }

    pub fn is_empty(&self) -> bool {
        self.values.is_empty() && self.noise.is_none()
    }

    /// Table, name and value of each parameter.
    pub fn values(&self) -> impl Iterator<Item = (&str, &str, &Value)> {
        self.values.iter().map(|((table, name), value)| (table.as_str(), name.as_str(), value))
    }

    /// The subset accepted by `takes`. Noise is always in it.
    #[must_use]
    pub fn filtered(&self, takes: impl Fn(&str, &str) -> bool) -> Self {
        let values = self.values.iter().filter(|((table, name), _)| takes(table, name));
        let values = values.map(|(key, value)| (key.clone(), value.clone())).collect();
        Self { values, noise: self.noise.clone() }
    }

    /// The settings without the camera's noise.
    #[must_use]
    pub fn without_noise(self) -> Self {
        Self { noise: None, ..self }
    }

    /// The table `[settings]` of the scene file `file`.
    pub fn to_toml(&self, file: &Path) -> Table {
        let mut settings = Table::new();
        let (rig, defaults) = (Rig::default(), Settings::default());
        let tables = ParameterValues { rig: &rig, settings: &defaults }.tables();
        let is_whole = |table: &str, name: &str| {
            let mut specs = tables.iter().filter(|params| params.table() == table).flat_map(|params| params.specs());
            specs.any(|spec| spec.name == name && matches!(spec.kind, Kind::Integer { .. }))
        };
        for ((table, name), value) in &self.values {
            let value = match value {
                Value::None => Toml::String(NONE.to_owned()),
                Value::Bool(on) => Toml::Boolean(*on),
                Value::Number(number) if is_whole(table, name) => Toml::Integer(*number as i64),
                Value::Number(number) => Toml::Float(*number),
                Value::Text(text) => Toml::String(text.clone()),
            };
            insert(&mut settings, table, name, value);
        }
        match self.noise() {
            Some(Some(profile)) => {
                let table = noise::to_toml(profile, file).to_string().parse::<Table>();
                for (name, value) in table.into_iter().flatten() {
                    insert(&mut settings, NOISE, &name, value);
                }
            }
            Some(None) => insert(&mut settings, NO_NOISE.0, NO_NOISE.1, Toml::String(NONE.to_owned())),
            None => {}
        }
        settings
    }
}

/// Inserts a value into a table by its dotted name.
fn insert(settings: &mut Table, table: &str, name: &str, value: Toml) {
    let mut at = settings;
    for part in table.split('.') {
        let inner = at.entry(part).or_insert_with(|| Toml::Table(Table::new()));
        let Some(inner) = inner.as_table_mut() else { return };
        at = inner;
    }
    at.insert(name.to_owned(), value);
}

fn type_error(path: &Path, table: &str, key: &str, actual: &Toml) -> ProfileError {
    let (table, actual) = (table.to_owned(), quoted(&actual.to_string()));
    ProfileError::Type { path: path.to_owned(), table, key: quoted(key), actual }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "scene.toml";
    const NOISE_KEYS: &str = "code = [8.0]\nsigma_r = [1.0]\nsigma_g = [1.0]\nsigma_b = [1.0]\n\
                              channel_correlation = [0.0, 0.0, 0.0]\nneighbour_correlation = [0.0, 0.0]\n";

    fn read(text: &str) -> Result<(ShotSettings, Rig, Settings), ProfileError> {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        rig.lens.aperture_diameter_mm = Some(5.0);
        let own = ShotSettings::read(&text.parse().unwrap(), Path::new(SCENE))?;
        own.apply(&mut rig, &mut settings, Path::new(SCENE))?;
        Ok((own, rig, settings))
    }

    #[test]
    fn differences_written_as_a_table_read_back_the_same() {
        let text = "[camera]\nreadout_time_s = 0.02\n[camera.exposure]\ntime_s = 0.01\n[camera.lens]\n\
                    aperture_diameter_mm = \"none\"\nf_number = 2.0\n[noise]\nscale = 0.5\non = false\n\
                    [camera.noise]\n";
        let (own, rig, settings) = read(&format!("{text}{NOISE_KEYS}")).unwrap();
        assert_eq!((rig.intrinsics.readout_time_s, rig.exposure.time_s), (0.02, Some(0.01)));
        assert_eq!((rig.lens.aperture_diameter_mm, rig.lens.f_number), (None, Some(2.0)));
        assert!(!settings.is_on("noise") && settings.overrule_recorded_exposure && rig.noise.is_some());
        let mut before = Rig::default();
        let now = ParameterValues { rig: &rig, settings: &settings };
        before.lens.aperture_diameter_mm = Some(5.0);
        let difference = ShotSettings::between(ParameterValues { rig: &before, settings: &Settings::default() }, now);
        assert_eq!(difference, own);
        assert_eq!(ShotSettings::read(&difference.to_toml(Path::new(SCENE)), Path::new(SCENE)).unwrap(), own);
        assert!(ShotSettings::between(now, now).is_empty());
    }

    #[test]
    fn removed_noise_is_a_difference_that_reads_back() {
        let (_, with, settings) = read(&format!("[camera.noise]\n{NOISE_KEYS}")).unwrap();
        let without = Rig { noise: None, ..with.clone() };
        let look = |rig| ParameterValues { rig, settings: &settings };
        let removed = ShotSettings::between(look(&with), look(&without));
        assert_eq!(removed.noise(), Some(None));
        assert_eq!(ShotSettings::read(&removed.to_toml(Path::new(SCENE)), Path::new(SCENE)).unwrap(), removed);
        let (mut rig, mut changed) = (with.clone(), settings.clone());
        removed.apply(&mut rig, &mut changed, Path::new(SCENE)).unwrap();
        assert_eq!(rig.noise, None);
    }

    #[test]
    fn unchanged_values_stay_even_if_equal_to_overridden_ones() {
        let pinned = "[camera.exposure]\ntime_s = 0.02\n[depth]\ntolerance_m = 0.03\n[noise]\non = false\n";
        let (own, rig, mut settings) = read(pinned).unwrap();
        let kept_settings = |settings: &Settings| {
            let now = ParameterValues { rig: &rig, settings };
            ShotSettings::between(now, now).with_unchanged(&own, now)
        };
        assert_eq!(kept_settings(&settings).values().count(), 3);
        settings.switch("noise", true).unwrap();
        assert!(!kept_settings(&settings).has("noise", ON) && kept_settings(&settings).has("depth", "tolerance_m"));
        // An override of each frame's exposure is preserved as a value.
        let mut without = settings.clone();
        without.overrule_recorded_exposure = false;
        let [before, now] = [&without, &settings].map(|settings| ParameterValues { rig: &rig, settings });
        assert!(ShotSettings::between(before, now).has("camera.exposure", "time_s"));
        assert!(ShotSettings::between(now, before).is_empty());
    }

    #[test]
    fn refused_values_name_the_scene_file_and_the_key() {
        for (text, message) in [
            ("noise = 1", "settings.noise = 1 is not"),
            ("[noise]\nscale = -1", "noise.scale = -1: expected a number from"),
            ("[nose]\nscale = 1", "there is no table [nose]"),
            ("[noise]\nscal = 1", "there is no parameter noise.scal"),
            ("[camera.lens]\nf_number = 2\naperture_diameter_mm = 5", "both aperture_diameter_mm and f_number"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.starts_with(SCENE) && error.contains(message), "{error}");
        }
    }
}
