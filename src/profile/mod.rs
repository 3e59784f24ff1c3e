//! `profiles/<name>.toml`: a camera's calibrated values, and the parameters of each effect. A
//! calibration file of another program is read in its place.
//!
//! A profile may have any of the tables of [`Rig::tables`] and of the settings. An unknown key is
//! an error that names it.

mod calibration_file;
mod document;
mod noise;
mod noise_model_file;
mod read;
mod response_file;
mod serialized;
mod shot_settings;
mod st_map_file;
mod st_samples;

pub use calibration_file::is_calibration;
pub use document::ProfileFile;
pub use noise::{NoiseTableError, to_toml as noise_table};
pub use shot_settings::{ParameterValues, ShotSettings};

use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::camera::{
    Camera, CameraExposure, Distortion, FrameOverrides, Geometry, Intrinsics, Lens, LensModel, NoiseProfile, Response,
};
use crate::compositor::Settings;
use crate::document::Problem;
use crate::frame::FrameLens;
use crate::params::{ParamError, Params, Value};
use crate::text::reason;

/// A camera as tables of parameters, before assembly.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    pub intrinsics: Intrinsics,
    pub distortion: Distortion,
    pub lens: Lens,
    pub exposure: CameraExposure,
    pub response: Response,
    pub noise: Option<NoiseProfile>,
    /// The given keys of the geometry: table and name. The defaults of the others are meaningless.
    set_keys: BTreeSet<(&'static str, &'static str)>,
    /// Keys that individual frames override ([`Rig::follow_frames`]).
    yielding: BTreeSet<(&'static str, &'static str)>,
}

/// The key of a lens's table.
const MAP_KEY: &str = "map";

/// The required keys of a complete camera. Without all of them there is no geometry.
const REQUIRED_KEYS: [&str; 6] = ["width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px"];

/// Why a profile or a setting was refused.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    #[error("{path}: cannot be read: {}", reason(source))]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{path}: {source}; expected a profile (TOML), see docs/guide.md")]
    Syntax { path: PathBuf, source: Problem },
    #[error("{path}: {source}")]
    Param { path: PathBuf, source: Box<ParamError> },
    #[error("{path}: {table}.{key} = {actual} is not a number, a boolean or a string")]
    Type { path: PathBuf, table: String, key: String, actual: String },
    #[error("{path}: there is no table [{table}]; known tables: {tables}")]
    UnknownTable { path: PathBuf, table: String, tables: String },
    #[error("{path}: `version` is {actual}; this program reads version 1: the file must contain `version = 1`")]
    Version { path: PathBuf, actual: String },
    #[error("{path}: {message}")]
    Noise { path: PathBuf, message: String },
    #[error(
        "{path}: [camera.lens] has both aperture_diameter_mm and f_number: expected one of them, since the focal \
         length follows from fx_px and film_width_mm"
    )]
    TwoOpenings { path: PathBuf },
    #[error(
        "{path}: camera.distortion.{name} is not 0, but the model {model} has no {name}; set it to 0, or name its model"
    )]
    Coefficient { path: PathBuf, name: &'static str, model: Value },
    #[error("{path}: {message}")]
    Response { path: PathBuf, message: String },
    #[error("{path}: {message}")]
    LensMap { path: PathBuf, message: String },
    /// A calibration file of another program.
    #[error("{path}: {message}")]
    Calibration { path: PathBuf, message: String },
}

/// A problem with a `--set table.name=value`.
#[derive(Debug, thiserror::Error)]
pub enum SetError {
    #[error("--set {text}: expected table.name=value, as in --set noise.scale=1.5")]
    Syntax { text: String },
    #[error("--set {text}: there is no table {table}; known tables: {tables}")]
    UnknownTable { text: String, table: String, tables: String },
    #[error("--set: {0}")]
    Param(Box<ParamError>),
}

/// A `--set table.name=value` in its parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetText<'a> {
    pub table: &'a str,
    pub name: &'a str,
    pub value: &'a str,
}

/// Splits a `--set table.name=value`. `None` if it has another form.
pub fn parse_set(text: &str) -> Option<SetText<'_>> {
    let (key, value) = text.split_once('=')?;
    let (table, name) = key.trim().rsplit_once('.')?;
    Some(SetText { table, name, value })
}

impl Rig {
    pub fn tables(&self) -> [&dyn Params; 5] {
        [&self.intrinsics, &self.distortion, &self.lens, &self.exposure, &self.response]
    }

    fn tables_mut(&mut self) -> [&mut dyn Params; 5] {
        [&mut self.intrinsics, &mut self.distortion, &mut self.lens, &mut self.exposure, &mut self.response]
    }

    /// Lets frames with a known camera and lens override the values given so far. Values set later
    /// override the frames. The readout time is always the rig's.
    pub fn follow_frames(&mut self) {
        let tables: [&dyn Params; 4] = [&self.intrinsics, &self.distortion, &self.lens, &self.exposure];
        let all = tables.into_iter().flat_map(|table| table.specs().into_iter().map(|spec| (table.table(), spec.name)));
        self.yielding = all.filter(|(_, name)| *name != "readout_time_s").collect();
    }

    fn is_overridable(&self, table: &dyn Params, names: &[&str]) -> bool {
        names.iter().all(|name| self.yielding.iter().any(|key| *key == (table.table(), *name)))
    }

    /// The lens parameters that frames override.
    fn frame_overrides(&self) -> FrameOverrides {
        FrameOverrides {
            opening: self.is_overridable(&self.lens, &["f_number", "aperture_diameter_mm"]),
            focus: self.is_overridable(&self.lens, &["focus_distance_m"]),
            exposure: self.is_overridable(&self.exposure, &["time_s", "shutter_angle_deg"]),
        }
    }

    /// The values of a frame's lens that are not overridden by the rig.
    pub fn effective_lens(&self, lens: FrameLens) -> FrameLens {
        let frame_overrides = self.frame_overrides();
        FrameLens {
            f_number: lens.f_number.filter(|_| frame_overrides.opening),
            focus_distance_m: lens.focus_distance_m.filter(|_| frame_overrides.focus),
            exposure_s: lens.exposure_s.filter(|_| frame_overrides.exposure),
            iso: lens.iso,
        }
    }

    /// True if the film's width was given.
    pub fn gives_film_width(&self) -> bool {
        self.set_keys.contains(&(self.intrinsics.table(), "film_width_mm"))
    }

    /// The missing keys of `[camera]` for a complete camera, out of width, height, focal lengths
    /// and principal point.
    pub fn missing_keys(&self) -> Vec<&'static str> {
        let table = self.intrinsics.table();
        // All other values of a 360° picture follow from its size.
        let round = self.distortion.model == LensModel::Equirectangular;
        let required = REQUIRED_KEYS.into_iter().filter(|name| !round || matches!(*name, "width_px" | "height_px"));
        required.filter(|name| !self.set_keys.contains(&(table, name))).collect()
    }

    /// True if focal lengths, principal point or distortion were given.
    pub fn gives_lens(&self) -> bool {
        let beside = ["width_px", "height_px", "film_width_mm", "readout_time_s"];
        self.set_keys.iter().any(|(_, name)| !beside.contains(name))
    }

    /// True if any key of a camera's geometry was given.
    pub fn gives_geometry(&self) -> bool {
        !self.set_keys.is_empty()
    }

    /// The given camera if it is complete. Otherwise the recording's own camera overridden by the
    /// given keys; keys that [follow the frames](Rig::follow_frames) apply only without an own
    /// camera. `None` if neither is complete.
    pub fn geometry_over(&self, own: Option<&Geometry>) -> Option<Geometry> {
        let holds = |key: &(&'static str, &'static str)| own.is_none() || !self.yielding.contains(key);
        let table = self.intrinsics.table();
        let stands_alone =
            self.missing_keys().is_empty() && REQUIRED_KEYS.into_iter().all(|name| holds(&(table, name)));
        if stands_alone {
            return Some(Geometry::new(self.intrinsics.clone(), self.distortion.clone()));
        }
        let own = own?;
        let (mut intrinsics, mut distortion) = (own.intrinsics.clone(), own.distortion.clone());
        let mut lens_map = None;
        let tables: [(&dyn Params, &mut dyn Params); 2] =
            [(&self.intrinsics, &mut intrinsics), (&self.distortion, &mut distortion)];
        for (from, to) in tables {
            for (_, name) in self.set_keys.iter().filter(|key| key.0 == from.table() && holds(key)) {
                if *name == MAP_KEY {
                    // Its text is long.
                    lens_map = Some(self.distortion.map.clone());
                    continue;
                }
                // It was accepted when it was given.
                from.get(name).and_then(|value| to.set(name, &value).ok())?;
            }
        }
        if let Some(map) = lens_map {
            distortion.map = map;
        }
        Some(Geometry::new(intrinsics, distortion))
    }

    /// Overrides a recording's own camera by the given values. Later settings override both.
    pub fn lay_over(&mut self, own: &Geometry) {
        if let Some(geometry) = self.geometry_over(Some(own)) {
            (self.intrinsics, self.distortion) = (geometry.intrinsics, geometry.distortion.unbound());
            self.set_keys.extend(REQUIRED_KEYS.map(|name| (Intrinsics::default().table(), name)));
        }
    }

    /// Sets focal lengths, principal point, distortion and the picture's size. The other values of
    /// the geometry (readout time, film) are kept.
    pub fn set_geometry(&mut self, geometry: &Geometry) {
        for name in REQUIRED_KEYS {
            // Both are in the same table.
            let _ = geometry.intrinsics.get(name).map(|value| self.intrinsics.set(name, &value));
        }
        self.distortion = geometry.distortion.unbound();
        self.set_keys.extend(REQUIRED_KEYS.map(|name| (self.intrinsics.table(), name)));
        let of_distortion = self.distortion.specs().into_iter().map(|spec| (self.distortion.table(), spec.name));
        self.set_keys.extend(of_distortion);
        let set = |key: &(&str, &str)| key.0 == self.distortion.table() || REQUIRED_KEYS.contains(&key.1);
        self.yielding.retain(|key| !set(key));
    }

    /// The camera, with a geometry if it is complete.
    pub fn camera(&self) -> Camera {
        Camera {
            geometry: self.geometry_over(None),
            lens: self.lens.clone(),
            exposure: self.exposure.clone(),
            response: self.response.clone(),
            noise: self.noise.clone(),
            frame_overrides: self.frame_overrides(),
        }
    }

    pub fn set(
        &mut self,
        settings: &mut Settings,
        table: &str,
        name: &str,
        value: &Value,
    ) -> Option<Result<(), ParamError>> {
        let done = self.tables_mut().into_iter().find(|t| t.table() == table).map(|own| own.set(name, value));
        if matches!(done, Some(Ok(()))) {
            self.yielding.retain(|key| *key != (table, name));
            let geometry: [&dyn Params; 2] = [&self.intrinsics, &self.distortion];
            let spec = geometry.into_iter().find(|t| t.table() == table).map(|t| (t.table(), t.specs()));
            if let Some((table, specs)) = spec {
                self.set_keys.extend(specs.into_iter().filter(|s| s.name == name).map(|s| (table, s.name)));
            }
            // Alternative keys of one quantity. The later one applies, as with any other setting.
            match (table, name) {
                ("camera.lens", "f_number") if *value != Value::None => self.lens.aperture_diameter_mm = None,
                ("camera.lens", "aperture_diameter_mm") if *value != Value::None => self.lens.f_number = None,
                _ => {}
            }
        }
        done.or_else(|| settings.set(table, name, value))
    }

    fn table_names(&self, settings: &Settings) -> Vec<&'static str> {
        let own = self.tables().map(|table| table.table()).into_iter().chain(["camera.noise"]);
        own.chain(settings.tables().iter().map(|table| table.table())).collect()
    }

    fn known_tables(&self, settings: &Settings) -> String {
        self.table_names(settings).join(", ")
    }

    /// Applies a `--set table.name=value`.
    pub fn set_text(&mut self, text: &str, settings: &mut Settings) -> Result<(), SetError> {
        let set = parse_set(text).ok_or_else(|| SetError::Syntax { text: text.to_owned() })?;
        let SetText { table, name, value } = set;
        if table == "camera.exposure" {
            settings.overrule_recorded_exposure = true;
        }
        match self.set(settings, table, name, &Value::parse(value)) {
            Some(done) => done.map_err(|source| SetError::Param(Box::new(source))),
            None => Err(SetError::UnknownTable {
                text: text.to_owned(),
                table: table.to_owned(),
                tables: self.known_tables(settings),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<(Rig, Settings), ProfileError> {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        rig.read_text(text, Path::new("p.toml"), &mut settings).map(|_| (rig, settings))
    }

    #[test]
    fn profile_tables_set_their_fields() {
        let (rig, settings) = read(
            "version = 1\n[camera]\nwidth_px = 320\nfx_px = 250.5\n[camera.distortion]\nmodel = \"opencv\"\nk1 = -0.1\n\
             [camera.exposure]\ntime_s = 0.01\n[noise]\nscale = 2\n[motion_blur]\nmethod = \"copies\"\n",
        )
        .unwrap();
        assert_eq!(rig.missing_keys(), ["height_px", "fy_px", "cx_px", "cy_px"]);
        assert!(rig.camera().geometry.is_none(), "what nobody gave is not made up");
        assert_eq!((rig.intrinsics.width_px, rig.intrinsics.fx_px, rig.distortion.k1), (320, 250.5, -0.1));
        assert_eq!(rig.exposure.time_s, Some(0.01));
        let noise = settings.tables().into_iter().find(|t| t.table() == "noise").unwrap().get("scale");
        assert_eq!(noise, Some(Value::Number(2.0)));
    }

    #[test]
    fn frames_override_given_values_and_later_settings_override_frames() {
        let whole = "version = 1\n[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 50\nfy_px = 51\ncx_px = 32\ncy_px = 24\n\
                     readout_time_s = 0.01\n[camera.lens]\nf_number = 4\n";
        let (mut rig, mut settings) = read(whole).unwrap();
        let lens = FrameLens { f_number: Some(2.0), focus_distance_m: Some(1.0), ..FrameLens::default() };
        assert_eq!(rig.effective_lens(lens), FrameLens::default());
        rig.follow_frames();
        let own = Geometry::new(
            Intrinsics { width_px: 64, height_px: 48, fx_px: 70.0, fy_px: 71.0, ..Intrinsics::default() },
            Distortion { k1: -0.2, ..Distortion::default() },
        );
        let fx = |rig: &Rig, own: Option<&Geometry>| rig.geometry_over(own).unwrap().intrinsics.fx_px;
        assert_eq!((fx(&rig, None), fx(&rig, Some(&own))), (50.0, 70.0));
        let geometry = rig.geometry_over(Some(&own)).unwrap();
        assert_eq!((geometry.intrinsics.readout_time_s, geometry.distortion.k1), (0.01, -0.2));
        assert_eq!(rig.effective_lens(lens), lens);
        assert_eq!(rig.camera().lens_in(&lens).f_number, Some(2.0));
        // An aperture without a focus would blur all near objects.
        let open = FrameLens { focus_distance_m: None, ..lens };
        assert_eq!(rig.camera().lens_in(&open).f_number, Some(4.0));
        rig.set_text("camera.fx_px=60", &mut settings).unwrap();
        rig.set_text("camera.lens.aperture_diameter_mm=3", &mut settings).unwrap();
        let text = serde_json::to_string(&rig).unwrap();
        for rig in [serde_json::from_str(&text).unwrap(), rig] {
            let i = rig.geometry_over(Some(&own)).unwrap().intrinsics;
            assert_eq!((i.fx_px, i.fy_px), (60.0, 71.0));
            assert_eq!(rig.effective_lens(lens), FrameLens { f_number: None, ..lens });
        }
    }

    #[test]
    fn incomplete_camera_overrides_that_of_the_recording() {
        let own = Geometry::new(
            Intrinsics { fx_px: 400.0, cx_px: 310.0, ..Intrinsics::default() },
            Distortion { k1: -0.2, ..Distortion::default() },
        );
        let (mut rig, mut settings) =
            read("version = 1\n[camera]\nfx_px = 500\n[camera.distortion]\nk2 = 0.1\n").unwrap();
        rig.set_text("camera.readout_time_s=0.01", &mut settings).unwrap();
        assert!(rig.geometry_over(None).is_none());
        let laid = rig.geometry_over(Some(&own)).unwrap();
        let expected = Intrinsics { fx_px: 500.0, readout_time_s: 0.01, ..own.intrinsics.clone() };
        assert_eq!(laid.intrinsics, expected);
        assert_eq!((laid.distortion.k1, laid.distortion.k2), (-0.2, 0.1));
        // Once laid over, later settings override.
        rig.lay_over(&own);
        rig.set_text("camera.fx_px=600", &mut settings).unwrap();
        let geometry = rig.camera().geometry.unwrap();
        assert_eq!(
            (geometry.intrinsics.fx_px, geometry.intrinsics.cx_px, geometry.distortion.k1),
            (600.0, 310.0, -0.2)
        );

        // A complete camera needs no other.
        let whole =
            "version = 1\n[camera]\nwidth_px = 64\nheight_px = 48\nfx_px = 50\nfy_px = 51\ncx_px = 32\ncy_px = 24\n";
        let (rig, _) = read(whole).unwrap();
        let geometry = rig.geometry_over(Some(&own)).unwrap();
        assert_eq!((geometry.intrinsics.fx_px, geometry.distortion.k1), (50.0, 0.0));
    }

    #[test]
    fn errors_name_key_file_and_range() {
        let error = |text: &str| read(text).err().unwrap().to_string();
        let e = error("version = 1\n[noise]\nscale = 99\n");
        assert!(e.contains("p.toml") && e.contains("noise.scale") && e.contains("0 to 8"), "{e}");
        let e = error("version = 1\n[noise]\nscael = 1\n");
        assert!(e.contains("noise.scael") && e.contains("magnification"), "{e}");
        let e = error("version = 1\n[nosie]\nscale = 1\n");
        assert!(e.contains("[nosie]") && e.contains("motion_blur"), "{e}");
        let e = error("version = 1\n[camera]\nfx_px = = 1\n");
        assert!(e.starts_with("p.toml: line 3, camera.fx_px: ") && !e.contains('\n'), "{e}");
        let e = error(&format!("version = 1\n[{}]\n", "x".repeat(100_000)));
        assert!(e.len() < 1000, "{} bytes", e.len());
        assert!(error("version = 2\n").contains("version"));
        assert!(error("[camera]\n").contains("missing"));
        let e = error("version = 1\n[camera.distortion]\nmodel = \"division\"\n");
        assert!(e.contains("expected opencv | opencv_fisheye"), "{e}");
        let e = error("version = 1\n[camera.distortion]\nmodel = \"opencv_fisheye\"\np1 = 0.1\n");
        assert!(e.contains("camera.distortion.p1") && e.contains("opencv_fisheye has no p1"), "{e}");
    }

    #[test]
    fn later_of_f_number_and_diameter_applies() {
        let (mut rig, mut settings) = read("version = 1\n[camera.lens]\naperture_diameter_mm = 0.0\n").unwrap();
        rig.set_text("camera.lens.f_number=2.8", &mut settings).unwrap();
        assert_eq!((rig.lens.aperture_diameter_mm, rig.lens.f_number), (None, Some(2.8)));
        assert!(rig.set_text("camera.lens.aperture_diameter_mm=-1", &mut settings).is_err());
        rig.set_text("camera.lens.aperture_diameter_mm=none", &mut settings).unwrap();
        assert_eq!(rig.lens.f_number, Some(2.8));
        rig.set_text("camera.lens.aperture_diameter_mm=10", &mut settings).unwrap();
        assert_eq!((rig.lens.aperture_diameter_mm, rig.lens.f_number), (Some(10.0), None));
        let both = read("version = 1\n[camera.lens]\naperture_diameter_mm = 5.0\nf_number = 2.0\n");
        assert!(both.unwrap_err().to_string().contains("one of them"));
    }

    #[test]
    fn set_option_reaches_the_tables_of_a_profile() {
        let (mut rig, mut settings) = (Rig::default(), Settings::default());
        rig.set_text("camera.lens.f_number=2.8", &mut settings).unwrap();
        rig.set_text("depth.occlusion=off", &mut settings).unwrap();
        assert_eq!(rig.lens.f_number, Some(2.8));
        assert!(!settings.depth.occlusion);
        for wrong in ["noise.scale", "scale=1", "nope.scale=1", "noise.scale=-1", "noise.scale=x"] {
            let name = wrong.split('=').next().unwrap();
            let error = rig.set_text(wrong, &mut settings).unwrap_err().to_string();
            assert!(error.contains(name), "{wrong}: {error}");
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[ -~\n]{0,200}") {
            let _ = read(&text);
            let _ = read(&format!("version = 1\n{text}"));
        }
    }
}
