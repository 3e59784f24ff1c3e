//! Complete serialization of a rig: unlike a profile it contains every value, and the set of given
//! keys.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Rig, noise_model_file};
use crate::camera::NoiseProfile;
use crate::params::{ParamError, Params, Value, values};

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct SerializedRig {
    tables: BTreeMap<String, BTreeMap<String, Value>>,
    #[serde(alias = "given")]
    set_keys: Vec<(String, String)>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    yielding: Vec<(String, String)>,
    noise: Option<NoiseProfile>,
    /// File of the camera's noise by example, absolute. Where it can no longer be read, the noise
    /// follows its table alone: unsaved work is worth more than its noise.
    #[serde(default, alias = "noise_example", skip_serializing_if = "Option::is_none")]
    noise_model_file: Option<PathBuf>,
}

/// Errors of a serialized rig.
#[derive(Debug, thiserror::Error)]
pub enum RigFormatError {
    #[error(transparent)]
    Parameter(#[from] ParamError),
    #[error("there is no table {0} of a camera")]
    Table(String),
    #[error("there is no key {0} of a camera's geometry")]
    Key(String),
}

impl From<Rig> for SerializedRig {
    fn from(rig: Rig) -> Self {
        let table = |table: &dyn Params| (table.table().to_owned(), values(table));
        let example = rig.noise.as_ref().and_then(|noise| noise.example.as_ref());
        let absolute = |file: &PathBuf| std::path::absolute(file).unwrap_or_else(|_| file.clone());
        let owned = |(table, name): &(&str, &str)| ((*table).to_owned(), (*name).to_owned());
        Self {
            tables: rig.tables().into_iter().map(table).collect(),
            set_keys: rig.set_keys.iter().map(owned).collect(),
            yielding: rig.yielding.iter().map(owned).collect(),
            noise_model_file: example.map(|example| absolute(&example.file)),
            noise: rig.noise,
        }
    }
}

impl TryFrom<SerializedRig> for Rig {
    type Error = RigFormatError;

    fn try_from(written: SerializedRig) -> Result<Self, RigFormatError> {
        let mut noise = written.noise;
        if let Some(noise) = &mut noise {
            noise.example = written.noise_model_file.and_then(|file| noise_model_file::read(&file).ok());
        }
        let mut rig = Self { noise, ..Self::default() };
        for (table, values) in &written.tables {
            let own = rig.tables_mut().into_iter().find(|own| own.table() == table);
            let own = own.ok_or_else(|| RigFormatError::Table(table.clone()))?;
            values.iter().try_for_each(|(name, value)| own.set(name, value))?;
        }
        for (table, name) in &written.set_keys {
            let names = {
                let geometry: [&dyn Params; 2] = [&rig.intrinsics, &rig.distortion];
                let named = |own: &&dyn Params| own.table() == table;
                let own = geometry.into_iter().find(named);
                own.and_then(|own| Some((own.table(), own.specs().into_iter().find(|spec| spec.name == name)?.name)))
            };
            rig.set_keys.insert(names.ok_or_else(|| RigFormatError::Key(format!("{table}.{name}")))?);
        }
        // Frames override no other keys.
        rig.follow_frames();
        rig.yielding.retain(|key| written.yielding.iter().any(|(table, name)| *key == (table.as_str(), name.as_str())));
        Ok(rig)
    }
}

impl Serialize for Rig {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        SerializedRig::from(self.clone()).serialize(to)
    }
}

impl<'de> Deserialize<'de> for Rig {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        SerializedRig::deserialize(from)?.try_into().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::compositor::Settings;

    #[test]
    fn serialized_rig_reads_back_completely() {
        let text = "version = 1\n[camera]\nfx_px = 500.1\n[camera.distortion]\nk1 = -0.1\n[camera.lens]\nf_number = 2.8\n\
                    [camera.noise]\ncode = [8.0, 24.5]\nsigma_r = [1, 2]\nsigma_g = [1, 2]\nsigma_b = [1, 2.5]\n\
                    channel_correlation = [0, 0, 0]\nneighbour_correlation = [0, 0.125]\n";
        let mut rig = Rig::default();
        rig.read_text(text, Path::new("p.toml"), &mut Settings::default()).unwrap();
        let written = serde_json::to_string(&rig).unwrap();
        let read: Rig = serde_json::from_str(&written).unwrap();
        assert!(read == rig && read.missing_keys() == rig.missing_keys() && read.gives_geometry());
        for (from, to) in [("camera.lens", "camera.lons"), ("\"k1\"", "\"q1\""), ("2.8", "-1")] {
            assert!(serde_json::from_str::<Rig>(&written.replace(from, to)).is_err(), "{from}");
        }
    }
}
