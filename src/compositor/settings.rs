//! Which effects are on, and their parameters.

use std::collections::BTreeMap;

use crate::camera::{Camera, Geometry};
use crate::effects::{self, Effect, EffectError, FrameContext};
use crate::params::{Kind, ParamError, Params, Value, values};

/// The key in an effect's table that switches the effect on. No effect has a parameter of this
/// name.
pub const ON: &str = "on";

/// Former names of parameters, as table, former name and name. They are read, and not written.
const RENAMED: [(&str, &str, &str); 1] = [("shadow", "on_things", "on_evidence")];

/// The name of a parameter, by its name or its former one.
pub fn current_name<'a>(table: &str, name: &'a str) -> &'a str {
    let renamed = RENAMED.into_iter().find(|(of_table, former, _)| *of_table == table && *former == name);
    renamed.map_or(name, |(_, _, current)| current)
}

crate::params! {
    /// Occlusion by the recording's depth.
    pub struct DepthSettings in "depth" at Depth {
        "hide objects behind nearer surfaces in the recording's depth" occlusion: bool = true;
        "how much nearer the real surface must be to hide an object" tolerance_m at Draw: f32 = 0.02, "m", 0.0..=100.0 => occlusion is "true";
    }
}

crate::params! {
    /// Shadows of virtual objects on the support plane and on each other.
    pub struct ShadowSettings in "shadow" at PlanarShadows {
        "objects block light from the real surface that they stand on" cast as "Cast shadows": bool = true;
        "objects block light from each other and from themselves" on_evidence as "Shadows on other evidence" at Lightmaps: bool = true => cast is "true";
        "opacity of shadows; 1 is correct for the scene's light" strength at ShadowMask: f32 = 1.0, "", 0.0..=2.0 => cast is "true";
    }
}

/// The settings of a composite: effects, occlusion and shadows. A plain value.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(try_from = "SerializedSettings", into = "SerializedSettings")]
pub struct Settings {
    /// Effects in the order in which they run.
    effects: Vec<Box<dyn Effect>>,
    /// True for each effect that may run.
    enabled: Vec<bool>,
    pub depth: DepthSettings,
    pub shadow: ShadowSettings,
    pub seed: u64,
    /// Whether the camera's exposure overrides that of each recorded frame.
    pub overrule_recorded_exposure: bool,
}

/// The serialised form of settings.
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct SerializedSettings {
    seed: u64,
    overrule_recorded_exposure: bool,
    /// Effects that are switched off.
    without: Vec<String>,
    /// Every parameter by its table and name.
    tables: BTreeMap<String, BTreeMap<String, Value>>,
}

impl From<Settings> for SerializedSettings {
    fn from(settings: Settings) -> Self {
        let off = settings.effects.iter().zip(&settings.enabled).filter(|(_, on)| !**on);
        Self {
            seed: settings.seed,
            overrule_recorded_exposure: settings.overrule_recorded_exposure,
            without: off.map(|(effect, _)| effect.table().to_owned()).collect(),
            tables: settings.tables().into_iter().map(|table| (table.table().to_owned(), values(table))).collect(),
        }
    }
}

/// Why serialized settings are invalid.
#[derive(Debug, thiserror::Error)]
pub enum DeserializeError {
    #[error(transparent)]
    Effect(#[from] SettingsError),
    #[error(transparent)]
    Parameter(#[from] ParamError),
    #[error("there is no table {0} of parameters")]
    Table(String),
}

impl TryFrom<SerializedSettings> for Settings {
    type Error = DeserializeError;

    fn try_from(written: SerializedSettings) -> Result<Self, DeserializeError> {
        let mut settings = Self {
            seed: written.seed,
            overrule_recorded_exposure: written.overrule_recorded_exposure,
            ..Self::default()
        };
        settings.without(&written.without)?;
        for (table, values) in &written.tables {
            for (name, value) in values {
                settings.set(table, name, value).ok_or_else(|| DeserializeError::Table(table.clone()))??;
            }
        }
        Ok(settings)
    }
}

/// A name that is not an effect's.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("there is no effect {name}; known effects: {effects}")]
pub struct SettingsError {
    pub name: String,
    pub effects: String,
}

impl Default for Settings {
    fn default() -> Self {
        let effects = effects::all();
        let enabled = vec![true; effects.len()];
        Self {
            effects,
            enabled,
            depth: DepthSettings::default(),
            shadow: ShadowSettings::default(),
            seed: 0,
            overrule_recorded_exposure: false,
        }
    }
}

impl Settings {
    fn position(&self, name: &str) -> Result<usize, SettingsError> {
        self.effects.iter().position(|e| e.table() == name).ok_or_else(|| SettingsError {
            name: name.to_owned(),
            effects: self.effects.iter().map(|e| e.table()).collect::<Vec<_>>().join(", "),
        })
    }

    /// Switches all effects off but those named.
    pub fn only(&mut self, names: &[String]) -> Result<(), SettingsError> {
        let indices = names.iter().map(|n| self.position(n)).collect::<Result<Vec<_>, _>>()?;
        self.enabled.iter_mut().enumerate().for_each(|(i, on)| *on = indices.contains(&i));
        Ok(())
    }

    /// Switches the named effects off.
    pub fn without(&mut self, names: &[String]) -> Result<(), SettingsError> {
        names.iter().try_for_each(|name| self.switch(name, false))
    }

    /// Switches an effect on or off.
    pub fn switch(&mut self, name: &str, on: bool) -> Result<(), SettingsError> {
        let i = self.position(name)?;
        self.enabled[i] = on;
        Ok(())
    }

    /// Names of the effects that are off.
    pub fn disabled(&self) -> impl Iterator<Item = &'static str> {
        self.effects.iter().zip(&self.enabled).filter(|(_, on)| !**on).map(|(effect, _)| effect.table())
    }

    /// Whether an effect is switched on. It may still be neutral. False for an unknown name.
    pub fn is_on(&self, name: &str) -> bool {
        self.on().any(|effect| effect.table() == name)
    }

    /// All effects in the order in which they run, on or off.
    pub fn effects(&self) -> impl Iterator<Item = &dyn Effect> {
        self.effects.iter().map(AsRef::as_ref)
    }

    /// Switches every effect, occlusion and shadows off. The camera's geometry stays on.
    pub fn plain(&mut self) {
        self.enabled.fill(false);
        self.depth.occlusion = false;
        self.shadow.cast = false;
    }

    /// Checks that the camera supports the effects that are on. Called before any output is
    /// written.
    pub fn check(&self, camera: &Camera, geometry: &Geometry) -> Result<(), EffectError> {
        self.on().try_for_each(|effect| effect.check(camera, geometry))
    }

    /// The effects that are switched on.
    pub fn on(&self) -> impl Iterator<Item = &dyn Effect> {
        self.effects.iter().zip(&self.enabled).filter(|(_, on)| **on).map(|(effect, _)| effect.as_ref())
    }

    /// The effects that are on and not neutral.
    pub fn active<'s>(&'s self, context: &FrameContext<'_>) -> Vec<&'s dyn Effect> {
        self.on().filter(|effect| !effect.is_neutral(context)).collect()
    }

    /// Whether an effect that is on acts on the real part too.
    pub fn acts_on_real(&self) -> bool {
        self.on().any(|effect| effect.on_real().acts())
    }

    /// The reason for each effect that is on but does nothing with this camera.
    pub fn ineffective_settings(&self, camera: &Camera) -> Vec<&'static str> {
        self.on().filter_map(|effect| effect.ineffective_setting(camera)).collect()
    }

    /// Every table of parameters that a profile or `--set` may write to.
    pub fn tables_mut(&mut self) -> Vec<&mut dyn Params> {
        let mut tables: Vec<&mut dyn Params> = vec![&mut self.depth, &mut self.shadow];
        tables.extend(self.effects.iter_mut().map(|e| -> &mut dyn Params { e.as_mut() }));
        tables
    }

    /// Every table of parameters.
    pub fn tables(&self) -> Vec<&dyn Params> {
        let mut tables: Vec<&dyn Params> = vec![&self.depth, &self.shadow];
        tables.extend(self.effects.iter().map(|e| -> &dyn Params { e.as_ref() }));
        tables
    }

    /// Sets one parameter, or with [`ON`] switches an effect. `None` if the table is not one of
    /// [`Settings::tables`]. Former names are accepted.
    pub fn set(&mut self, table: &str, name: &str, value: &Value) -> Option<Result<(), ParamError>> {
        if name == ON
            && let Ok(effect) = self.position(table)
        {
            let Value::Bool(on) = value else {
                let [table, name, actual] = [table.to_owned(), name.to_owned(), value.to_string()];
                let (accepted, unit) = (Kind::Bool.to_string(), String::new());
                return Some(Err(ParamError::Refused { table, name, actual, accepted, unit }));
            };
            self.enabled[effect] = *on;
            return Some(Ok(()));
        }
        let name = current_name(table, name);
        self.tables_mut().into_iter().find(|t| t.table() == table).map(|t| t.set(name, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_are_switched_by_name() {
        let mut settings = Settings::default();
        settings.only(&["noise".to_owned()]).unwrap();
        assert_eq!(settings.on().map(|effect| effect.table()).collect::<Vec<_>>(), ["noise"]);
        settings.switch("motion_blur", true).unwrap();
        assert!(settings.is_on("motion_blur") && !settings.is_on("point_spread") && !settings.is_on("grian"));
        let error = settings.without(&["grian".to_owned()]).unwrap_err().to_string();
        assert!(error.contains("grian") && error.contains("motion_blur"), "{error}");
    }

    #[test]
    fn on_key_switches_an_effect_and_refuses_other_values_and_tables() {
        let mut settings = Settings::default();
        settings.set("noise", ON, &Value::Bool(false)).unwrap().unwrap();
        let mut expected = Settings::default();
        expected.without(&["noise".to_owned()]).unwrap();
        assert!(settings == expected && settings != Settings::default());
        let error = settings.set("noise", ON, &Value::Number(1.0)).unwrap().unwrap_err().to_string();
        assert!(error.contains("noise.on = 1") && error.contains("true or false"), "{error}");
        assert!(settings.set("depth", ON, &Value::Bool(false)).unwrap().is_err(), "depth is no effect");
        settings.set("noise", ON, &Value::Bool(true)).unwrap().unwrap();
        assert!(settings == Settings::default());
        for table in settings.tables() {
            assert!(table.get(ON).is_none(), "{}", table.table());
        }
    }

    #[test]
    fn former_name_sets_the_renamed_parameter() {
        let mut settings = Settings::default();
        settings.set("shadow", "on_things", &Value::Bool(false)).unwrap().unwrap();
        assert!(!settings.shadow.on_evidence && settings.shadow.get("on_things").is_none());
        assert!(settings.set("depth", "on_things", &Value::Bool(false)).unwrap().is_err());
    }

    #[test]
    fn default_of_every_parameter_is_accepted() {
        let mut settings = Settings::default();
        for table in settings.tables_mut() {
            for spec in table.specs() {
                table.set(spec.name, &spec.default).unwrap();
                assert!(!spec.help.is_empty());
            }
        }
    }
}
