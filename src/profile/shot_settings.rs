//! Parameters that a scene file sets for its shot: its `[settings]`, which has the tables of a
//! profile. They override the profile and an analysis; `--set` overrides them.

use std::collections::BTreeMap;
use std::path::Path;

use toml::{Table, Value as Toml};

use super::{ProfileError, Rig, noise};
use crate::camera::NoiseProfile;
use crate::compositor::{ON, Settings};
use crate::params::{Kind, Params, Value};
use crate::words::quoted;

const NOISE: &str = "camera.noise";
/// In a file: the parameter has no value, whatever the profile gives it.
const NONE: &str = "none";

/// A camera and the effects' parameters, to be compared.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    pub rig: &'a Rig,
    pub settings: &'a Settings,
}

impl<'a> Look<'a> {
    fn tables(self) -> Vec<&'a dyn Params> {
        self.rig.tables().into_iter().chain(self.settings.tables()).collect()
    }
}

/// Values by table and name, and whether effects are on by [`ON`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShotSettings {
    values: BTreeMap<(String, String), Value>,
    noise: Option<NoiseProfile>,
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
            self.noise = Some(noise::from_toml(keys).map_err(failed)?);
            return Ok(());
        }
        for (key, value) in keys {
            let value = match value {
                Toml::Table(inner) => {
                    self.read_table(&format!("{table}.{key}"), inner, path)?;
                    continue;
                }
                Toml::Boolean(on) => Value::Bool(*on),
                Toml::Integer(number) => Value::Number(*number as f64),
                Toml::Float(number) => Value::Number(*number),
                Toml::String(text) if text == NONE => Value::None,
                Toml::String(text) => Value::Text(text.clone()),
                other => return Err(type_error(path, table, key, other)),
            };
            self.values.insert((table.to_owned(), key.clone()), value);
        }
        Ok(())
    }

    /// The values that differ from `before` in `now`.
    pub fn between(before: Look<'_>, now: Look<'_>) -> Self {
        let mut found = Self::default();
        for (old, new) in before.tables().into_iter().zip(now.tables()) {
            for spec in new.specs() {
                let value = new.get(spec.name).filter(|value| old.get(spec.name).as_ref() != Some(value));
                let key = (new.table().to_owned(), spec.name.to_owned());
                found.values.extend(value.map(|value| (key, value)));
            }
        }
        for effect in now.settings.effects().map(|effect| effect.table()) {
            let on = now.settings.is_on(effect);
            if before.settings.is_on(effect) != on {
                found.values.insert((effect.to_owned(), ON.to_owned()), Value::Bool(on));
            }
        }
        found.noise = now.rig.noise.clone().filter(|noise| before.rig.noise.as_ref() != Some(noise));
        found
    }

    /// Sets the values; `path` is named in errors. An exposure overrides that of each frame, as
    /// `--set` does.
    pub fn apply(&self, rig: &mut Rig, settings: &mut Settings, path: &Path) -> Result<(), ProfileError> {
        let exposure = rig.exposure.table();
        // Of an aperture diameter and an f-number, a value replaces the other one. So those without
        // a value come first.
        let (without, with): (Vec<_>, Vec<_>) = self.values.iter().partition(|(_, value)| **value == Value::None);
        for ((table, name), value) in without.into_iter().chain(with) {
            settings.overrule_recorded_exposure |= table == exposure;
            let failed = |source| ProfileError::Param { path: path.to_owned(), source: Box::new(source) };
            match rig.set(settings, table, name, value) {
                Some(done) => done.map_err(failed)?,
                None => {
                    let known = rig.known_tables(settings);
                    return Err(ProfileError::UnknownTable { path: path.to_owned(), table: quoted(table), known });
                }
            }
        }
        if self.noise.is_some() {
            rig.noise.clone_from(&self.noise);
        }
        Ok(())
    }

    /// Whether a parameter is among them.
    pub fn has(&self, table: &str, name: &str) -> bool {
        self.values.contains_key(&(table.to_owned(), name.to_owned()))
    }

    pub fn has_noise(&self) -> bool {
        self.noise.is_some()
    }

    pub fn is_empty(&self) -> bool {
        self.values.is_empty() && self.noise.is_none()
    }

    /// Table and name of each value.
    pub fn keys(&self) -> impl Iterator<Item = (&str, &str)> {
        self.values.keys().map(|(table, name)| (table.as_str(), name.as_str()))
    }

    /// Those of some parameters alone.
    #[must_use]
    pub fn filtered(&self, takes: impl Fn(&str, &str) -> bool) -> Self {
        let values = self.values.iter().filter(|((table, name), _)| takes(table, name));
        let values = values.map(|(key, value)| (key.clone(), value.clone())).collect();
        Self { values, noise: self.noise.clone() }
    }

    /// The table `[settings]` of a scene file.
    pub fn to_toml(&self) -> Table {
        let mut settings = Table::new();
        let (rig, defaults) = (Rig::default(), Settings::default());
        let tables = Look { rig: &rig, settings: &defaults }.tables();
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
        let noise = self.noise.as_ref().and_then(|noise| noise::to_toml(noise).to_string().parse::<Table>().ok());
        for (name, value) in noise.into_iter().flatten() {
            insert(&mut settings, NOISE, &name, value);
        }
        settings
    }
}

/// Puts a value into a table by its dotted name.
fn insert(settings: &mut Table, table: &str, name: &str, value: Toml) {
    let mut at = settings;
    for part in table.split('.') {
        let inner = at.entry(part).or_insert_with(|| Toml::Table(Table::new()));
        let Some(inner) = inner.as_table_mut() else { return };
        at = inner;
    }
    at.insert(name.to_owned(), value);
}

fn type_error(path: &Path, table: &str, key: &str, found: &Toml) -> ProfileError {
    let (table, found) = (table.to_owned(), quoted(&found.to_string()));
    ProfileError::Type { path: path.to_owned(), table, key: quoted(key), found }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "scene.toml";

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
                    [camera.noise]\ncode = [8.0]\nsigma_r = [1.0]\nsigma_g = [1.0]\nsigma_b = [1.0]\n\
                    channel_correlation = [0.0, 0.0, 0.0]\nneighbour_correlation = [0.0, 0.0]\n";
        let (own, rig, settings) = read(text).unwrap();
        assert_eq!((rig.intrinsics.readout_time_s, rig.exposure.time_s), (0.02, Some(0.01)));
        assert_eq!((rig.lens.aperture_diameter_mm, rig.lens.f_number), (None, Some(2.0)));
        assert!(!settings.is_on("noise") && settings.overrule_recorded_exposure && rig.noise.is_some());
        let (mut before, now) = (Rig::default(), Look { rig: &rig, settings: &settings });
        before.lens.aperture_diameter_mm = Some(5.0);
        let found = ShotSettings::between(Look { rig: &before, settings: &Settings::default() }, now);
        assert_eq!(found, own);
        assert_eq!(ShotSettings::read(&found.to_toml(), Path::new(SCENE)).unwrap(), own);
        assert!(ShotSettings::between(now, now).is_empty());
    }

    #[test]
    fn refused_values_name_the_scene_file_and_the_key() {
        for (text, told) in [
            ("noise = 1", "settings.noise = 1 is not"),
            ("[noise]\nscale = -1", "noise.scale = -1 is refused"),
            ("[nose]\nscale = 1", "there is no table [nose]"),
            ("[noise]\nscal = 1", "there is no parameter noise.scal"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.starts_with(SCENE) && error.contains(told), "{error}");
        }
    }
}
