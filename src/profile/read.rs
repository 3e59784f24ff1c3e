//! Reads profiles.

use std::path::Path;

use super::calibration_file::{self, is_calibration};
use super::noise::{self, ExampleLoading};
use super::shot_settings::ShotSettings;
use super::{ProfileError, Rig, response_file, st_map_file};
use crate::compositor::Settings;
use crate::document as text;
use crate::params::{Params, Value};
use crate::source::file::{self, MAX_DOCUMENT_BYTES};
use crate::text::quoted;

/// Destination of the values of a profile's text.
struct ReadTarget<'a> {
    /// The profile's file.
    path: &'a Path,
    settings: &'a mut Settings,
    values: &'a mut ShotSettings,
    loading: ExampleLoading<'a>,
}

impl Rig {
    /// The camera parameters of a profile.
    pub fn of_file(path: &Path) -> Result<Self, ProfileError> {
        let mut rig = Self::default();
        rig.read(path, &mut Settings::default())?;
        Ok(rig)
    }

    /// Reads a profile, overriding the rig and the settings. Returns the values that it gives.
    pub fn read(&mut self, path: &Path, settings: &mut Settings) -> Result<ShotSettings, ProfileError> {
        let text = file::read_text(path, MAX_DOCUMENT_BYTES)
            .map_err(|source| ProfileError::Read { path: path.to_owned(), source })?;
        self.read_text(&text, path, settings)
    }

    /// Like [`Rig::read`], from a text; `path` is for error messages. A calibration file of another
    /// program replaces size, focal lengths, principal point and distortion.
    pub fn read_text(
        &mut self,
        text: &str,
        path: &Path,
        settings: &mut Settings,
    ) -> Result<ShotSettings, ProfileError> {
        if is_calibration(path, text) {
            return self.read_calibration(text, path, settings);
        }
        self.read_with(text, path, settings, ExampleLoading::BesideFile(path))
    }

    fn read_calibration(
        &mut self,
        text: &str,
        path: &Path,
        settings: &mut Settings,
    ) -> Result<ShotSettings, ProfileError> {
        let failed = |message| ProfileError::Calibration { path: path.to_owned(), message };
        let mut shot_settings = ShotSettings::default();
        for (table, name, value) in calibration_file::read(text).map_err(failed)? {
            // Both tables are the rig's own.
            if let Some(Err(source)) = self.set(settings, table, name, &value) {
                return Err(ProfileError::Param { path: path.to_owned(), source: Box::new(source) });
            }
            shot_settings.insert(table, name, value);
        }
        Ok(shot_settings)
    }

    /// Checks the text of a profile without the files that it names.
    pub(super) fn check_text(text: &str, path: &Path) -> Result<(), ProfileError> {
        if is_calibration(path, text) {
            let message = "is a calibration of another program, which is read as a profile and not written; choose \
                           another name for the profile"
                .to_owned();
            return Err(ProfileError::Calibration { path: path.to_owned(), message });
        }
        Self::default().read_with(text, path, &mut Settings::default(), ExampleLoading::Skip).map(drop)
    }

    fn read_with(
        &mut self,
        text: &str,
        path: &Path,
        settings: &mut Settings,
        loading: ExampleLoading<'_>,
    ) -> Result<ShotSettings, ProfileError> {
        let path = path.to_owned();
        let mut shot_settings = ShotSettings::default();
        let mut root: toml::Table =
            text::read(text).map_err(|source| ProfileError::Syntax { path: path.clone(), source })?;
        match root.remove("version") {
            Some(toml::Value::Integer(1)) => {}
            other => {
                let actual = other.map_or_else(|| "missing".to_owned(), |v| quoted(&v.to_string()));
                return Err(ProfileError::Version { path, actual });
            }
        }
        for (name, value) in root {
            let mut target = ReadTarget { path: &path, settings, values: &mut shot_settings, loading };
            self.read_table(&name, value, &mut target)?;
        }
        match self.distortion.missing() {
            Some(name) => {
                let model = self.distortion.get("model").unwrap_or(Value::None);
                Err(ProfileError::Coefficient { path, name, model })
            }
            None => Ok(shot_settings),
        }
    }

    fn read_table(&mut self, table: &str, value: toml::Value, target: &mut ReadTarget<'_>) -> Result<(), ProfileError> {
        let ReadTarget { path, loading, .. } = *target;
        let unknown = |rig: &Self, settings: &Settings| ProfileError::UnknownTable {
            path: path.to_owned(),
            table: quoted(table),
            tables: rig.known_tables(settings),
        };
        let toml::Value::Table(mut entries) = value else { return Err(unknown(self, target.settings)) };
        if !self.table_names(target.settings).contains(&table) {
            return Err(unknown(self, target.settings));
        }
        if table == "camera.noise" {
            let noise = noise::from_toml(&entries, loading)
                .map_err(|e| ProfileError::Noise { path: path.to_owned(), message: e.to_string() })?;
            target.values.set_noise(noise.clone());
            self.noise = Some(noise);
            return Ok(());
        }
        if table == self.distortion.table() {
            let profile = match loading {
                ExampleLoading::Skip => None,
                ExampleLoading::BesideFile(path) => Some(path),
            };
            st_map_file::resolve(&mut entries, profile)
                .map_err(|message| ProfileError::LensMap { path: path.to_owned(), message })?;
        }
        if table == "camera.lens" && ["aperture_diameter_mm", "f_number"].iter().all(|key| entries.contains_key(*key)) {
            return Err(ProfileError::TwoOpenings { path: path.to_owned() });
        }
        for (key, value) in entries {
            let as_value = match &value {
                toml::Value::Table(_) if table == "camera" => {
                    self.read_table(&format!("camera.{key}"), value, target)?;
                    continue;
                }
                toml::Value::Boolean(b) => Value::Bool(*b),
                toml::Value::Integer(i) => Value::Number(*i as f64),
                toml::Value::Float(f) => Value::Number(*f),
                toml::Value::String(s) if table == "camera.response" && key == response_file::TABLE => {
                    // Texts are checked without the files that they name.
                    match loading {
                        ExampleLoading::Skip => continue,
                        ExampleLoading::BesideFile(path) => response_file::points(s, path)
                            .map_err(|message| ProfileError::Response { path: path.to_owned(), message })?,
                    }
                }
                toml::Value::String(s) => Value::Text(s.clone()),
                other => {
                    return Err(ProfileError::Type {
                        path: path.to_owned(),
                        table: table.to_owned(),
                        key: quoted(&key),
                        actual: quoted(&other.to_string()),
                    });
                }
            };
            match self.set(target.settings, table, &key, &as_value) {
                Some(Ok(())) => target.values.insert(table, &key, as_value),
                Some(Err(source)) => {
                    return Err(ProfileError::Param { path: path.to_owned(), source: Box::new(source) });
                }
                None => return Err(unknown(self, target.settings)),
            }
        }
        Ok(())
    }
}
