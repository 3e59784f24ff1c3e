//! Layers of parameter values: profiles, estimates of an analysis, a scene file's settings and
//! `--set`. Each is sparse; the values of the higher ones override those of the lower ones. Of the
//! estimates, only the readout time overrides profiles.

use std::path::{Path, PathBuf};

use super::ShotError;
use super::options::ShotOptions;
use crate::analyse::{Analysis, NoiseFindings};
use crate::camera::{CameraExposure, Lens, NoiseProfile};
use crate::compositor::Settings;
use crate::effects::point_spread::sigma_for_measured_px;
use crate::example_noise::NoiseModelFile;
use crate::params::Value;
use crate::profile::{ParameterValues, Rig, ShotSettings, parse_set};
use crate::recording::Recording;
use crate::scene;

/// A layer of given values, in order of increasing precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ValueLayer {
    Profile,
    Scene,
    Set,
}

/// The values that the layers result in.
#[derive(Clone, Debug, Default)]
pub struct ResolvedSettings {
    pub rig: Rig,
    pub settings: Settings,
}

impl ResolvedSettings {
    pub fn values(&self) -> ParameterValues<'_> {
        ParameterValues { rig: &self.rig, settings: &self.settings }
    }
}

/// The layers of a shot.
#[derive(Clone, Debug)]
pub struct SettingsLayers {
    /// The profiles that were read, the recording's own first.
    profiles: Vec<PathBuf>,
    of_profiles: ShotSettings,
    /// The values by the profiles and the recording's own camera.
    base: ResolvedSettings,
    estimates: Vec<EstimatedParam>,
    /// The camera's noise by an analysis, below the profiles.
    estimated_noise: Option<NoiseProfile>,
    estimated_example: Option<NoiseModelFile>,
    /// The scene file and its settings.
    scene: PathBuf,
    of_scene: ShotSettings,
    /// Values as `table.name=value`, in order of increasing precedence.
    sets: Vec<String>,
}

impl SettingsLayers {
    /// Reads the profiles and the scene file's settings.
    pub fn read(recording: &Recording, options: &ShotOptions) -> Result<Self, ShotError> {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        rig.response.clone_from(recording.response());
        let mut of_profiles = ShotSettings::default();
        let profiles: Vec<_> = recording.camera_profile.iter().chain(&options.profile).cloned().collect();
        let of_recording = recording.camera_profile.iter().len();
        // The lens data of a stream is current, that of a profile is older. A profile that is named
        // for a recording is meant to override the recording's lens data.
        let yield_at = if recording.is_live() { profiles.len() } else { of_recording };
        for (at, profile) in profiles.iter().enumerate() {
            if at == yield_at && recording.has_individual_cameras() {
                rig.follow_frames();
            }
            of_profiles = rig.read(profile, &mut settings)?.or(&of_profiles);
        }
        if yield_at == profiles.len() && recording.has_individual_cameras() {
            rig.follow_frames();
        }
        if let Some(geometry) = &recording.geometry {
            rig.lay_over(geometry);
        }
        let scene = options.scene.clone().unwrap_or_default();
        let of_scene = ShotSettings::read(&scene::document::settings(&scene)?, &scene)?;
        let (base, sets) = (ResolvedSettings { rig, settings }, options.sets.clone());
        Ok(Self {
            profiles,
            of_profiles,
            base,
            estimates: Vec::new(),
            estimated_noise: None,
            estimated_example: None,
            scene,
            of_scene,
            sets,
        })
    }

    /// The profiles that were read, the recording's own first.
    pub fn profiles(&self) -> &[PathBuf] {
        &self.profiles
    }

    pub fn sets(&self) -> &[String] {
        &self.sets
    }

    /// The camera by the profiles and the recording alone.
    pub fn rig_of_profiles(&self) -> &Rig {
        &self.base.rig
    }

    /// The highest layer that gives a parameter.
    pub fn highest_layer_with(&self, table: &str, name: &str) -> Option<ValueLayer> {
        let is_it = |text: &String| parse_set(text).is_some_and(|set| (set.table, set.name) == (table, name));
        if self.sets.iter().any(is_it) {
            Some(ValueLayer::Set)
        } else if self.of_scene.has(table, name) {
            Some(ValueLayer::Scene)
        } else if self.of_profiles.has(table, name) {
            Some(ValueLayer::Profile)
        } else {
            None
        }
    }

    /// The layers without the scene's settings.
    pub fn without_scene(&self) -> Self {
        Self { of_scene: ShotSettings::default(), ..self.clone() }
    }

    /// The values of all layers.
    pub fn resolve(&self) -> Result<ResolvedSettings, ShotError> {
        let ResolvedSettings { mut rig, mut settings } = self.base.clone();
        rig.noise = rig.noise.or_else(|| self.effective_noise().cloned());
        self.of_scene.apply(&mut rig, &mut settings, &self.scene)?;
        for text in &self.sets {
            rig.set_text(text, &mut settings)?;
        }
        EstimatedParam::apply(self.effective_estimates(), &mut rig, &mut settings);
        Ok(ResolvedSettings { rig, settings })
    }

    /// The camera with lens and exposure by the scene's settings and `--set` alone.
    pub fn rig_over_profiles(&self) -> Rig {
        let (mut rig, mut unused) = (self.base.rig.clone(), Settings::default());
        (rig.lens, rig.exposure) = (Lens::default(), CameraExposure::default());
        // Each of the values was accepted before.
        let _ = self.of_scene.apply(&mut rig, &mut unused, &self.scene);
        for text in &self.sets {
            let _ = rig.set_text(text, &mut unused);
        }
        rig
    }

    /// The estimates that no other layer overrides.
    pub fn effective_estimates(&self) -> impl Iterator<Item = &EstimatedParam> {
        self.estimates.iter().filter(|estimate| match self.highest_layer_with(estimate.table, estimate.name) {
            None => true,
            Some(ValueLayer::Profile) => estimate.overrides_profiles(),
            Some(ValueLayer::Scene | ValueLayer::Set) => false,
        })
    }

    /// Replaces the estimates by those of an analysis.
    pub fn set_estimates(&mut self, analysis: &Analysis) {
        self.estimates = EstimatedParam::all_of(analysis);
        self.estimated_noise = analysis.findings.noise.as_ref().and_then(NoiseFindings::profile);
        self.estimated_example = analysis.example_noise.as_ref().map(|file| file.example.clone());
    }

    /// Noise by example of the recording itself.
    pub fn estimated_example(&self) -> Option<&NoiseModelFile> {
        self.estimated_example.as_ref()
    }

    /// The camera's noise by an analysis, if no profile gives or removes it.
    pub fn effective_noise(&self) -> Option<&NoiseProfile> {
        self.estimated_noise.as_ref().filter(|_| self.base.rig.noise.is_none() && self.of_profiles.noise().is_none())
    }

    /// Replaces the scene's settings by values that were accepted before.
    pub fn set_scene(&mut self, of_scene: &ShotSettings) {
        self.of_scene.clone_from(of_scene);
    }

    /// Replaces the profiles by ones into which these values were written.
    pub fn replace_profiles(&mut self, profiles: Vec<PathBuf>, values: &ShotSettings) {
        self.profiles = profiles;
        let ResolvedSettings { rig, settings } = &mut self.base;
        // A profile cannot express that its exposure overrides each frame's own.
        let is_overruled = settings.overrule_recorded_exposure;
        // The values were accepted when they were set.
        let _ = values.apply(rig, settings, Path::new(""));
        settings.overrule_recorded_exposure = is_overruled;
        self.of_profiles = values.clone().or(&self.of_profiles);
    }
}

/// Tables and parameters: of the readout time, and of the camera's sharpness.
const READOUT: (&str, &str) = ("camera", "readout_time_s");
const SHARPNESS: (&str, &str) = ("point_spread", "sigma_px");

/// A parameter with the value that the analysis estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedParam {
    pub table: &'static str,
    pub name: &'static str,
    pub value: Value,
}

impl EstimatedParam {
    /// The parameters that an analysis estimated.
    pub fn all_of(analysis: &Analysis) -> Vec<Self> {
        let param = |(table, name), number| Self { table, name, value: Value::Number(number) };
        let findings = &analysis.findings;
        let readout = analysis.refined().map(|_| param(READOUT, findings.camera.intrinsics.readout_time_s));
        let sigma_px = findings.spread.as_ref().and_then(|spread| spread.sigma_px);
        let sharpness = sigma_px.map(|sigma_px| param(SHARPNESS, sigma_for_measured_px(sigma_px)));
        readout.into_iter().chain(sharpness).collect()
    }

    /// Sets the parameters to the estimated values.
    pub fn apply<'a>(estimates: impl IntoIterator<Item = &'a Self>, rig: &mut Rig, settings: &mut Settings) {
        for Self { table, name, value } in estimates {
            // The analysis estimates values within the range.
            let _ = rig.set(settings, table, name, value);
        }
    }

    /// True for the readout time, which overrides profiles.
    pub fn overrides_profiles(&self) -> bool {
        (self.table, self.name) == READOUT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::NoiseBin;

    fn values(text: &str) -> ShotSettings {
        ShotSettings::read(&text.parse().unwrap(), Path::new("scene.toml")).unwrap()
    }

    fn layers(profile: &str, scene: &str, sets: &[&str]) -> SettingsLayers {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        let text = format!("version = 1\n{profile}");
        let of_profiles = rig.read_text(&text, Path::new("p.toml"), &mut settings).unwrap();
        let estimate = |(table, name), number| EstimatedParam { table, name, value: Value::Number(number) };
        SettingsLayers {
            profiles: Vec::new(),
            of_profiles,
            base: ResolvedSettings { rig, settings },
            estimates: vec![estimate(READOUT, 0.02), estimate(SHARPNESS, 0.75)],
            estimated_noise: None,
            estimated_example: None,
            scene: PathBuf::new(),
            of_scene: values(scene),
            sets: sets.iter().map(|&text| text.to_owned()).collect(),
        }
    }

    /// Readout time and sharpness of all layers, and of those without the scene.
    fn resolved(layers: &SettingsLayers) -> [(f64, Value); 2] {
        [layers.resolve(), layers.without_scene().resolve()].map(|resolved| {
            let ResolvedSettings { rig, settings } = resolved.unwrap();
            let table = settings.tables().into_iter().find(|table| table.table() == SHARPNESS.0).unwrap();
            (rig.intrinsics.readout_time_s, table.get(SHARPNESS.1).unwrap())
        })
    }

    #[test]
    fn estimated_noise_is_used_where_nothing_else_gives_noise() {
        const NOISE: &str = "[camera.noise]\ncode = [0]\nsigma_r = [1]\nsigma_g = [1]\nsigma_b = [1]\n\
                             channel_correlation = [0, 0, 0]\nneighbour_correlation = [0, 0]\n";
        let estimate = NoiseProfile {
            example: None,
            bins: std::array::from_fn(|_| vec![NoiseBin { code: 128.0, sigma: 2.0 }]),
            channel_correlation: [0.0; 3],
            neighbour_correlation: [0.0; 2],
        };
        let sigma = |profile: &str, scene: &str| {
            let layers = SettingsLayers { estimated_noise: Some(estimate.clone()), ..layers(profile, scene, &[]) };
            layers.resolve().unwrap().rig.noise.map(|noise| noise.sigma(0, 50.0))
        };
        assert_eq!(sigma("", ""), Some(2.0));
        assert_eq!(sigma(NOISE, ""), Some(1.0));
        assert_eq!(sigma("", NOISE), Some(1.0));
        assert_eq!(sigma("", "[camera]\nnoise = \"none\"\n"), None);
    }

    #[test]
    fn estimates_override_the_layers_below_them() {
        let number = Value::Number;
        let readout = "[camera]\nreadout_time_s = 0.01\n";
        // The default is a given value too.
        let default = Settings::default();
        let table = default.tables().into_iter().find(|table| table.table() == SHARPNESS.0).unwrap();
        let Value::Number(default_px) = table.get(SHARPNESS.1).unwrap() else { panic!("a number") };
        let sharpness = format!("[point_spread]\nsigma_px = {default_px:?}\n");
        assert_eq!(resolved(&layers("", "", &[])), [(0.02, number(0.75)), (0.02, number(0.75))]);
        let by_profile = layers(&format!("{readout}{sharpness}"), "", &[]);
        assert_eq!(resolved(&by_profile), [(0.02, number(default_px)), (0.02, number(default_px))]);
        assert_eq!(by_profile.effective_estimates().count(), 1);
        let by_scene = layers("", &format!("{readout}{sharpness}"), &[]);
        assert_eq!(resolved(&by_scene), [(0.01, number(default_px)), (0.02, number(0.75))]);
        let by_set = layers("", "", &[" camera.readout_time_s = 0.03", "point_spread.sigma_px=0.5"]);
        assert_eq!(resolved(&by_set), [(0.03, number(0.5)), (0.03, number(0.5))]);
        assert_eq!(by_set.effective_estimates().count(), 0);
    }

    #[test]
    fn highest_layer_that_gives_a_parameter_is_named() {
        let mut layers = layers("[noise]\nscale = 2\n", "[noise]\nscale = 1.5\non = false\n", &["noise.scale=1"]);
        assert_eq!(layers.highest_layer_with("noise", "scale"), Some(ValueLayer::Set));
        assert_eq!(layers.highest_layer_with("noise", "on"), Some(ValueLayer::Scene));
        assert_eq!(layers.highest_layer_with("noise", "iso"), None);
        layers.sets.clear();
        layers.set_scene(&ShotSettings::default());
        assert_eq!(layers.highest_layer_with("noise", "scale"), Some(ValueLayer::Profile));
        layers.replace_profiles(Vec::new(), &values("[noise]\niso = 800\n"));
        assert_eq!(layers.highest_layer_with("noise", "iso"), Some(ValueLayer::Profile));
        assert_eq!(layers.highest_layer_with("noise", "scale"), Some(ValueLayer::Profile));
    }
}
