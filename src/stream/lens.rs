//! Converts between the camera and lens data of an OpenTrackIO stream and those of this program.
//! The numbers have the meaning of OpenLensIO, as in `open_lens.rs`.

use std::fmt;

use ciborium::value::Value;
use glam::DVec2;

use super::open_lens::OpenLens;
use super::sample::{Sample, map, member, number};
use crate::camera::{CameraExposure, Distortion, Geometry, Intrinsics, Lens, LensModel};
use crate::params::{ParamError, Params, Value as Given};
use crate::pose::Pose;

/// Camera and lens data received from a stream so far. `None` if not received yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LensState {
    /// F, mm.
    pub focal_length_mm: Option<f64>,
    pub focus_distance_m: Option<f64>,
    pub f_stop: Option<f64>,
    pub t_stop: Option<f64>,
    /// Distance of the entrance pupil, the centre of projection, in front of the sensor, metres.
    pub entrance_pupil_m: Option<f64>,
    pub distortion: Option<OpenLens>,
    /// Name of an unsupported distortion model.
    pub other_model: Option<String>,
    /// ΔC, mm.
    pub distortion_offset_mm: Option<DVec2>,
    /// ΔP, mm.
    pub projection_offset_mm: Option<DVec2>,
    pub sensor_mm: Option<DVec2>,
    pub sensor_px: Option<[u32; 2]>,
    pub iso: Option<f64>,
    pub shutter_angle_deg: Option<f64>,
    pub frame_rate_hz: Option<f64>,
}

/// Reason why a stream's lens gives no camera.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StreamLensError {
    #[error("the stream has not sent {0}")]
    Missing(&'static str),
    #[error("its distortion has no inverse on the sensor")]
    Distortion,
    #[error("its distortion has the model {}, which is not supported", crate::text::quoted(.0))]
    Model(String),
    #[error("{0}")]
    Param(Box<ParamError>),
}

impl LensState {
    /// Updates the state with the camera and lens data of a sample.
    pub fn update(&mut self, sample: &Sample) {
        fn take<T>(to: &mut Option<T>, value: Option<T>) {
            *to = value.or(to.take());
        }
        let above_zero = |path: &[&str]| sample.number(path).filter(|number| *number > 0.0);
        let pair = |path: &[&str], [x, y]: [&str; 2]| {
            let value = sample.get(path)?;
            Some(DVec2::new(number(member(value, x)?)?, number(member(value, y)?)?))
        };
        take(&mut self.focal_length_mm, above_zero(&["lens", "pinholeFocalLength"]));
        take(&mut self.focus_distance_m, above_zero(&["lens", "focusDistance"]));
        take(&mut self.f_stop, above_zero(&["lens", "fStop"]));
        take(&mut self.t_stop, above_zero(&["lens", "tStop"]));
        take(&mut self.entrance_pupil_m, sample.number(&["lens", "entrancePupilOffset"]));
        take(&mut self.distortion_offset_mm, pair(&["lens", "distortionOffset"], ["x", "y"]));
        take(&mut self.projection_offset_mm, pair(&["lens", "projectionOffset"], ["x", "y"]));
        let sensor = pair(&["static", "camera", "activeSensorPhysicalDimensions"], ["width", "height"]);
        take(&mut self.sensor_mm, sensor.filter(|size| size.min_element() > 0.0));
        let pixels = ["width", "height"].map(|side| {
            sample.unsigned(&["static", "camera", "activeSensorResolution", side]).and_then(|n| u32::try_from(n).ok())
        });
        take(&mut self.sensor_px, pixels[0].zip(pixels[1]).map(|(width, height)| [width, height]));
        take(&mut self.iso, above_zero(&["static", "camera", "isoSpeed"]));
        take(&mut self.shutter_angle_deg, sample.number(&["static", "camera", "shutterAngle"]));
        take(&mut self.frame_rate_hz, sample.ratio(&["static", "camera", "captureFrameRate"]));
        if let Some(list) = sample.get(&["lens", "distortion"]).and_then(Value::as_array) {
            let lenses: Vec<OpenLens> = list.iter().filter_map(OpenLens::read).collect();
            let model = list.first().and_then(|first| member(first, "model")?.as_text());
            self.other_model = model.filter(|_| lenses.is_empty()).map(str::to_owned);
            // A model in this program's direction needs no fit.
            self.distortion = lenses.iter().find(|lens| lens.distorts).or(lenses.first()).cloned();
        }
    }

    /// The camera's pose, at the entrance pupil, from the sensor's: OpenLensIO (1).
    pub fn at_pupil(&self, sensor: &Pose) -> Pose {
        let mut pose = *sensor;
        pose.translation_m.z -= self.entrance_pupil_m.unwrap_or(0.0);
        pose
    }

    /// The camera for pictures of this size that show the whole sensor, and the largest error of
    /// its distortion, px.
    pub fn geometry(&self, width_px: u32, height_px: u32) -> Result<(Geometry, f64), StreamLensError> {
        let focal_mm = self.focal_length_mm.ok_or(StreamLensError::Missing("lens.pinholeFocalLength"))?;
        let sensor_mm =
            self.sensor_mm.ok_or(StreamLensError::Missing("static.camera.activeSensorPhysicalDimensions"))?;
        if let Some(model) = &self.other_model {
            return Err(StreamLensError::Model(model.clone()));
        }
        let size_px = DVec2::new(width_px.into(), height_px.into());
        let px_per_mm = size_px / sensor_mm;
        let offset_mm = self.projection_offset_mm.unwrap_or_default();
        let (f, c) = (focal_mm * px_per_mm, 0.5 * size_px + offset_mm * px_per_mm);
        let (mut intrinsics, mut distortion) = (Intrinsics::default(), Distortion::default());
        let set = |table: &mut dyn Params, name: &str, value: f64| {
            table.set(name, &Given::Number(value)).map_err(|error| StreamLensError::Param(Box::new(error)))
        };
        let values = [("width_px", size_px.x), ("height_px", size_px.y), ("film_width_mm", sensor_mm.x)];
        let places = [("fx_px", f.x), ("fy_px", f.y), ("cx_px", c.x), ("cy_px", c.y)];
        for (name, value) in values.into_iter().chain(places) {
            set(&mut intrinsics, name, value)?;
        }
        let mut off_px = 0.0;
        if let Some(lens) = &self.distortion {
            let centre_mm = self.distortion_offset_mm.unwrap_or_default();
            let (coefficients, off_mm) = match lens.as_opencv(focal_mm).filter(|_| centre_mm == DVec2::ZERO) {
                Some(exact) => (exact, 0.0),
                None => lens.fit(focal_mm, sensor_mm, offset_mm, centre_mm).ok_or(StreamLensError::Distortion)?,
            };
            for (name, value) in ["k1", "k2", "k3", "p1", "p2"].into_iter().zip(coefficients) {
                set(&mut distortion, name, value)?;
            }
            off_px = off_mm * px_per_mm.max_element();
        }
        Ok((Geometry::new(intrinsics, distortion), off_px))
    }

    /// The lens. Values outside their range are left out.
    pub fn lens(&self) -> Lens {
        let mut lens = Lens::default();
        for (name, value) in [("f_number", self.f_stop), ("focus_distance_m", self.focus_distance_m)] {
            let _ = value.map(|value| lens.set(name, &Given::Number(value)));
        }
        lens
    }

    /// The exposure. The shutter angle is the open part of the frame interval. Values outside their
    /// range are left out.
    pub fn exposure(&self) -> CameraExposure {
        let mut exposure = CameraExposure::default();
        for (name, value) in [("shutter_angle_deg", self.shutter_angle_deg), ("iso", self.iso)] {
            let _ = value.map(|value| exposure.set(name, &Given::Number(value)));
        }
        exposure
    }

    /// Exposure time, seconds: angle/360 of the frame interval.
    pub fn shutter_s(&self) -> Option<f64> {
        Some(self.shutter_angle_deg? / 360.0 / self.frame_rate_hz?)
    }

    /// Lens data of this program's camera, whose poses are those of the entrance pupil. Distortion
    /// of a fisheye and 360° pictures cannot be represented.
    pub fn of(geometry: &Geometry, lens: &Lens, exposure: &CameraExposure, frame_rate_hz: f64) -> Self {
        let i = &geometry.intrinsics;
        let size_px = DVec2::new(i.width_px.into(), i.height_px.into());
        let focal_mm = i.fx_px * i.film_width_mm / size_px.x;
        // A common focal length for both directions: the difference is the shape of the pixels.
        let sensor_mm = size_px * focal_mm / DVec2::new(i.fx_px, i.fy_px);
        let shutter = |time_s: f64| 360.0 * time_s * frame_rate_hz;
        let shutter_angle_deg = exposure.shutter_angle_deg.or(exposure.time_s.map(shutter));
        let exposed = Self {
            f_stop: lens.thin_lens(geometry).ok().flatten().map(|lens| lens.f_number()),
            focus_distance_m: lens.focus_distance_m,
            iso: exposure.iso,
            shutter_angle_deg: shutter_angle_deg.filter(|angle| (0.0..=360.0).contains(angle)),
            frame_rate_hz: Some(frame_rate_hz),
            ..Self::default()
        };
        if geometry.is_equirectangular() {
            return exposed;
        }
        let d = &geometry.distortion;
        let is_said = d.model == LensModel::Opencv && !d.is_identity();
        let f2 = focal_mm * focal_mm;
        Self {
            focal_length_mm: Some(focal_mm),
            projection_offset_mm: Some((DVec2::new(i.cx_px, i.cy_px) - 0.5 * size_px) * sensor_mm / size_px),
            sensor_mm: Some(sensor_mm),
            sensor_px: Some([i.width_px, i.height_px]),
            distortion: is_said.then(|| OpenLens {
                distorts: true,
                radial: vec![d.k1 / f2, 0.0, d.k2 / (f2 * f2), 0.0, d.k3 / (f2 * f2 * f2), 0.0],
                tangential: [d.p1 / focal_mm, d.p2 / focal_mm],
            }),
            ..exposed
        }
    }

    /// Writes the data that change from sample to sample, and with `all` also the static data.
    pub fn write(&self, sample: &mut Sample, all: bool) {
        let mut put = |path: &[&str], value: Option<Value>| _ = value.map(|value| sample.set(path, value));
        let pair = |v: DVec2, [x, y]: [&'static str; 2]| map([(x, v.x.into()), (y, v.y.into())]);
        put(&["lens", "distortion"], self.distortion.as_ref().map(|lens| Value::Array(vec![lens.write()])));
        put(&["lens", "distortionOffset"], self.distortion_offset_mm.map(|v| pair(v, ["x", "y"])));
        put(&["lens", "entrancePupilOffset"], self.entrance_pupil_m.map(Value::from));
        put(&["lens", "fStop"], self.f_stop.map(Value::from));
        put(&["lens", "tStop"], self.t_stop.map(Value::from));
        put(&["lens", "pinholeFocalLength"], self.focal_length_mm.map(Value::from));
        put(&["lens", "focusDistance"], self.focus_distance_m.map(Value::from));
        put(&["lens", "projectionOffset"], self.projection_offset_mm.map(|v| pair(v, ["x", "y"])));
        if !all {
            return;
        }
        let camera = |name| ["static", "camera", name];
        put(&camera("captureFrameRate"), self.frame_rate_hz.map(super::sample::rational));
        let size = self.sensor_mm.map(|v| pair(v, ["width", "height"]));
        put(&camera("activeSensorPhysicalDimensions"), size);
        let pixels = self.sensor_px.map(|[w, h]| map([("width", w.into()), ("height", h.into())]));
        put(&camera("activeSensorResolution"), pixels);
        put(&camera("isoSpeed"), self.iso.map(|iso| Value::from(iso.round().max(1.0) as u64)));
        put(&camera("shutterAngle"), self.shutter_angle_deg.map(Value::from));
    }
}

impl fmt::Display for LensState {
    /// The known data in one line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use crate::text::short;
        let some = |value: Option<f64>, before: &str, unit: &str| value.map(|v| format!("{before}{}{unit}", short(v)));
        let direction = |lens: &OpenLens| lens.model().to_owned();
        let parts = [
            some(self.focal_length_mm, "focal length ", " mm"),
            some(self.focus_distance_m, "focus at ", " m"),
            some(self.f_stop, "f/", ""),
            some(self.t_stop, "T", ""),
            some(self.entrance_pupil_m, "entrance pupil at ", " m"),
            self.distortion.as_ref().map(direction).or_else(|| self.other_model.as_deref().map(crate::text::quoted)),
            self.sensor_mm.map(|v| format!("sensor {}x{} mm", short(v.x), short(v.y))),
            self.sensor_px.map(|[w, h]| format!("{w}x{h} px")),
            some(self.frame_rate_hz, "", " frames a second"),
            some(self.shutter_angle_deg, "shutter ", "°"),
            some(self.iso, "ISO ", ""),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        f.write_str(if parts.is_empty() { "nothing was received of it" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::Encoding;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    fn state(text: &str) -> LensState {
        let mut state = LensState::default();
        state.update(&Sample::decode(Encoding::Json, text.as_bytes()).unwrap());
        state
    }

    #[test]
    fn lens_matches_computed_values() {
        let state = state(
            r#"{"static":{"camera":{"activeSensorPhysicalDimensions":{"width":36.0,"height":24.0},"isoSpeed":4000,
            "shutterAngle":180.0,"captureFrameRate":{"num":24,"denom":1}}},
            "lens":{"pinholeFocalLength":24.0,"fStop":4.0,"focusDistance":10.0,"projectionOffset":{"x":0.9,"y":-0.6},
            "distortion":[{"radial":[1e-9]},{"model":"Brown-Conrady U-D","radial":[-1e-4,0,2e-7,0,0,0],"tangential":[1e-3,2e-3]}]}}"#,
        );
        // 1920 px over 36 mm are 53.33 px/mm, 1280 over 24 as many: fx = 24·53.33 = 1280.
        let (geometry, off_px) = state.geometry(1920, 1280).unwrap();
        let (i, d) = (&geometry.intrinsics, &geometry.distortion);
        assert!((i.fx_px - 1280.0).abs() < 1e-9 && (i.fy_px - 1280.0).abs() < 1e-9);
        assert!((i.cx_px - 1008.0).abs() < 1e-9 && (i.cy_px - 608.0).abs() < 1e-9, "{} {}", i.cx_px, i.cy_px);
        // k1 = −1e-4·24² , k2 = 2e-7·24⁴, p = 24 times.
        for (actual, expected) in [(d.k1, -0.0576), (d.k2, 0.066_355_2), (d.k3, 0.0), (d.p1, 0.024), (d.p2, 0.048)] {
            assert!((actual - expected).abs() < 1e-12, "{actual} is not {expected}");
        }
        assert_eq!((off_px, i.film_width_mm), (0.0, 36.0));
        assert_eq!((state.lens().f_number, state.lens().focus_distance_m), (Some(4.0), Some(10.0)));
        assert_eq!((state.exposure().iso, state.exposure().shutter_angle_deg), (Some(4000.0), Some(180.0)));
        assert!((state.shutter_s().unwrap() - 1.0 / 48.0).abs() < 1e-15);
    }

    #[test]
    fn entrance_pupil_is_in_front_of_the_sensor() {
        // The sensor at (0, 0, 1) points along the world's y; its pupil is 0.1 m further along it.
        let turn = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        let sensor = Pose::from_camera_in_world(DVec3::Z, turn);
        let pupil = state(r#"{"lens":{"entrancePupilOffset":0.1}}"#).at_pupil(&sensor);
        assert!((pupil.position_in_world_m() - DVec3::new(0.0, 0.1, 1.0)).length() < 1e-12);
    }

    /// Distance between a point's projections by the stream's formula and by the converted camera,
    /// px.
    fn off_px(state: &LensState, geometry: &Geometry, at: DVec2) -> f64 {
        let [w, h] = [geometry.intrinsics.width_px, geometry.intrinsics.height_px].map(f64::from);
        let (sensor, focal) = (state.sensor_mm.unwrap(), state.focal_length_mm.unwrap());
        let (offset, centre) =
            (state.projection_offset_mm.unwrap_or_default(), state.distortion_offset_mm.unwrap_or_default());
        let lens = state.distortion.as_ref().unwrap();
        let here = at * sensor - offset;
        let there = lens.apply(here - centre) + centre;
        let (u, d) = if lens.distorts { (here, there) } else { (there, here) };
        let expected = DVec2::new(w, h) * ((d + offset) / sensor + 0.5);
        geometry.distorted_px(u / focal).distance(expected)
    }

    proptest! {
        /// For both directions, denominators, tangential terms and different centres: the reported
        /// error of the fit is correct.
        #[test]
        fn reported_error_of_the_fit_is_correct(
            k in prop::array::uniform4(-0.08f64..0.08), p in prop::array::uniform2(-0.004f64..0.004),
            distorts in any::<bool>(), centre in prop::array::uniform2(-0.5f64..0.5),
            places in prop::collection::vec(prop::array::uniform2(-0.5f64..0.5), 20),
        ) {
            let focal = 25.0;
            let radial = [2, 2, 4, 4].iter().zip(k).map(|(power, k)| k / f64::powi(focal, *power)).collect();
            let state = LensState {
                focal_length_mm: Some(focal),
                sensor_mm: Some(DVec2::new(24.0, 13.5)),
                projection_offset_mm: Some(DVec2::new(0.3, -0.2)),
                distortion_offset_mm: Some(centre.into()),
                distortion: Some(OpenLens { distorts, radial, tangential: p.map(|p| p / focal) }),
                ..LensState::default()
            };
            let (geometry, reported_px) = state.geometry(1920, 1080).unwrap();
            let worst_px = places.iter().map(|at| off_px(&state, &geometry, DVec2::from(*at))).fold(0.0, f64::max);
            // Between the fitted points the error may be slightly larger than at them.
            prop_assert!(worst_px <= 1.2 * reported_px + 0.01, "{worst_px} px, told {reported_px}");
        }

        #[test]
        fn own_camera_round_trips(
            f in prop::array::uniform2(300.0f64..3000.0), c in prop::array::uniform2(-50.0f64..50.0), film in 4.0f64..50.0,
            k in prop::array::uniform5(-0.2f64..0.2),
        ) {
            let intrinsics = Intrinsics {
                width_px: 1920, height_px: 1080, fx_px: f[0], fy_px: f[1], cx_px: 960.0 + c[0], cy_px: 540.0 + c[1],
                film_width_mm: film, ..Intrinsics::default()
            };
            let distortion =
                Distortion { k1: k[0], k2: k[1], k3: k[2], p1: 0.1 * k[3], p2: 0.1 * k[4], ..Distortion::default() };
            let sent = Geometry::new(intrinsics, distortion);
            let lens = Lens { f_number: Some(5.6), focus_distance_m: Some(3.0), ..Lens::default() };
            let exposure = CameraExposure { time_s: Some(0.01), iso: Some(800.0), ..CameraExposure::default() };
            let state = LensState::of(&sent, &lens, &exposure, 25.0);
            let mut sample = Sample::default();
            state.write(&mut sample, true);
            let mut received = LensState::default();
            received.update(&Sample::decode(Encoding::Cbor, &sample.encode(Encoding::Cbor).unwrap()).unwrap());
            let (back, off_px) = received.geometry(1920, 1080).unwrap();
            prop_assert_eq!(off_px, 0.0);
            for at in [[0.0, 0.0], [960.0, 540.0], [1900.0, 20.0], [300.0, 1000.0]] {
                let Some(ray) = sent.unproject(at.into()) else { continue };
                prop_assert!((back.project(ray).unwrap() - DVec2::from(at)).length() < 1e-6);
            }
            prop_assert!((received.lens().f_number.unwrap() - 5.6).abs() < 1e-9);
            prop_assert!((received.exposure().shutter_angle_deg.unwrap() - 90.0).abs() < 1e-9);
            prop_assert!((received.shutter_s().unwrap() - 0.01).abs() < 1e-12);
        }

        /// Any numbers give a camera or an error.
        #[test]
        fn any_lens_gives_a_camera_or_an_error(radial in prop::collection::vec(any::<f64>(), 0..14), f in any::<f64>(), w in any::<f64>()) {
            let mut state = LensState {
                focal_length_mm: Some(f), sensor_mm: Some(DVec2::new(w, f)),
                distortion: Some(OpenLens { distorts: false, radial, tangential: [f, w] }),
                ..LensState::default()
            };
            let _ = state.geometry(640, 480).map_err(|error| error.to_string());
            state.distortion.as_mut().unwrap().distorts = true;
            let _ = (state.geometry(640, 480).map_err(|error| error.to_string()), state.to_string(), state.lens(), state.exposure());
        }
    }

    #[test]
    fn default_model_is_converted_within_a_hundredth_of_a_pixel() {
        // A barrel by the inverse model, k = −1e-4 mm⁻²: at the corner, r = 13.77 mm, k·r² = 0.019.
        // Ours ends at r⁷; the term after it is about 55·0.019⁴ = 7e-6 of the 1100 px from the
        // middle: 0.008 px, before the fit.
        let state = LensState {
            focal_length_mm: Some(25.0),
            sensor_mm: Some(DVec2::new(24.0, 13.5)),
            distortion: Some(OpenLens { distorts: false, radial: vec![-1e-4], ..OpenLens::default() }),
            ..LensState::default()
        };
        let (geometry, reported_px) = state.geometry(1920, 1080).unwrap();
        assert!(reported_px < 0.01, "{reported_px}");
        // U = ε(1 − 1e-4·100) = 9.9 mm at 10 mm to the right: the ray by 9.9/25 lands 10 mm, 800
        // px, from the middle.
        let at = geometry.project(DVec3::new(9.9, 0.0, 25.0)).unwrap();
        assert!(at.distance(DVec2::new(1760.0, 540.0)) < 0.01, "{at}");
    }

    #[test]
    fn missing_data_are_named() {
        let error = |text: &str| state(text).geometry(640, 480).unwrap_err().to_string();
        assert!(error("{}").contains("pinholeFocalLength"));
        assert!(error(r#"{"lens":{"pinholeFocalLength":20}}"#).contains("activeSensorPhysicalDimensions"));
        let full = |distortion: &str| {
            format!(
                r#"{{"static":{{"camera":{{"activeSensorPhysicalDimensions":{{"width":36,"height":24}}}}}},"lens":{{"pinholeFocalLength":20,"distortion":{distortion}}}}}"#
            )
        };
        assert!(error(&full(r#"[{"model":"Splines","radial":[1]}]"#)).contains("Splines"));
        // The distortion folds on the sensor.
        assert!(error(&full(r#"[{"radial":[-0.01]}]"#)).contains("no inverse"));
    }
}
