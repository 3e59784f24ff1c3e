//! Exposure of the virtual layer: brighter or darker by ΔEV stops (camera/exposure.rs).
//!
//! - `photographic` (default): light times 2^ΔEV. Overexposed light clips at the very end, after
//!   mixing and noise.
//! - `additive`: vSLRcam (11) as printed: 0.2 · ΔEV added to display values, 0 to 1.
//!
//! ΔEV is `ev` plus, if `reference_s` is given, the stops by which the frame was exposed longer
//! than that. A scene whose lights were measured at one exposure then follows a camera with
//! automatic exposure. A frame of unknown exposure counts as exposed like the reference. A
//! photograph's own stops, which apply to real and virtual objects, are a factor on light with
//! either method.
//!
//! For analysed footage, `follow` multiplies the layer's light by the frame's estimated gain
//! relative to the recording's median frame, for each channel: automatic exposure, gain and white
//! balance. The estimate overrides the recorded values: `reference_s` is compared with the median
//! frame's recorded exposure. [`SpatialGain`] makes parts of the layer brighter: 2^stops, linear
//! between nodes.
//!
//! Not modelled: the effect of exposure on noise (noise.rs uses the resulting code value) and on
//! blur (its length is the camera's exposure time already).

use glam::DVec2;

use super::{Case, Effect, FrameContext, LayerRun, curve_choice, response_samples};
use crate::camera::exposure::{additive, photographic_gain};
use crate::camera::{Intrinsics, Response};
use crate::frame::{FrameExposure, NODES, SpatialGain};
use crate::gpu::{Shader, ShaderEntry};
use crate::params::Value;
use crate::render::{COLOR, Layer};

crate::choices! {
    /// How exposure acts.
    pub enum ExposureMethod { Photographic = "photographic", Additive = "additive" }
}

crate::params! {
    /// Parameters of the exposure.
    pub struct Exposure in "exposure" at Effects {
        "how much brighter objects are, in stops: 1 is twice the light; 0 is as lit"
        ev as "Exposure offset": f64 = 0.0, "EV", -10.0..=10.0;
        "photographic: factor on light; additive: a constant step of the displayed brightness"
        method: ExposureMethod = ExposureMethod::Photographic;
        "exposure for which the scene's lights are correct: time x gain (x ISO/100 / f-number^2 where frames report them); none: any exposure; 30 stops at most in total"
        reference_s: Option<f64> = None, "s", 1e-9..=1e6, by_ratio;
        "whether objects follow the footage's changes of brightness and colour from frame to frame, if it was analysed"
        follow as "Follow the footage": bool = true;
    }
}

crate::uniform! {
    struct ExposureUniform {
        gain: f32,
        step: f32,
        picture: f32,
        gamma: f32,
        factors: [f32; 4],
        share: [f32; 2],
        share_at_0: [f32; 2],
        across: [[f32; 4]; NODES / 4],
    }
}

/// A frame's exposure, as the equivalent time at f/1, ISO 100 and gain 1, s. Unknown settings count
/// as these; `None` without a time.
pub fn equivalent_exposure_s(recorded: &FrameExposure) -> Option<f64> {
    let time_s = recorded.reported_s()?;
    let speed = recorded.photo.iso.map_or(1.0, |iso| iso / 100.0);
    let f_number = recorded.photo.f_number.unwrap_or(1.0);
    Some(time_s * recorded.gain.unwrap_or(1.0) * speed / (f_number * f_number)).filter(|s| s.is_finite() && *s > 0.0)
}

impl Exposure {
    /// Exposure change of a frame's layer, stops; within ±30.
    pub fn over_ev(&self, recorded: &FrameExposure) -> f64 {
        let median_s = recorded.brightness.filter(|_| self.follow).map(|brightness| brightness.median_s);
        let of_frame = || median_s.unwrap_or_else(|| equivalent_exposure_s(recorded));
        let longer = self.reference_s.and_then(|reference_s| Some((of_frame()? / reference_s).log2()));
        (self.ev + longer.unwrap_or(0.0)).clamp(-30.0, 30.0)
    }

    /// Estimated gain of the frame, applied to the layer: red, green, blue.
    pub fn factors(&self, recorded: &FrameExposure) -> [f64; 3] {
        recorded.brightness.filter(|_| self.follow).map_or([1.0; 3], |brightness| brightness.factors)
    }

    fn spatial_gain(&self, recorded: &FrameExposure) -> SpatialGain {
        recorded.brightness.filter(|_| self.follow).map_or(SpatialGain::default(), |brightness| brightness.spatial_gain)
    }
}

/// Exposure change of the whole picture, real and virtual, stops.
fn picture_ev(context: &FrameContext<'_>) -> f64 {
    context.capture.over_ev.clamp(-30.0, 30.0)
}

/// Mapping of the layer's pixels to the recorded picture, in shares of its width and height: the
/// increment per pixel, and the value at the layer's origin. For a photograph's lens, only
/// principal point and focal length are mapped, not distortion.
fn shares(context: &FrameContext<'_>, begins_px: [i32; 2]) -> ([f32; 2], [f32; 2]) {
    let [made, recorded] = [context.picture, &context.capture.recorded].map(|geometry| &geometry.intrinsics);
    let focal = |i: &Intrinsics| DVec2::new(i.fx_px, i.fy_px);
    let middle = |i: &Intrinsics| DVec2::new(i.cx_px, i.cy_px);
    let size = DVec2::new(recorded.width_px.into(), recorded.height_px.into());
    let per_px = focal(recorded) / focal(made) / size;
    let begins = DVec2::from(begins_px.map(f64::from));
    let at_0 = middle(recorded) / size + (begins - middle(made)) * per_px;
    (per_px.as_vec2().to_array(), at_0.as_vec2().to_array())
}

impl Effect for Exposure {
    fn summary(&self) -> &'static str {
        "makes objects brighter or darker by stops"
    }
    fn neutral_hint(&self) -> &'static str {
        "objects keep their brightness; an exposure offset other than 0 or a reference time enables it"
    }
    fn is_neutral(&self, context: &FrameContext<'_>) -> bool {
        self.over_ev(&context.recorded) == 0.0
            && picture_ev(context) == 0.0
            && self.factors(&context.recorded) == [1.0; 3]
            && self.spatial_gain(&context.recorded).is_none()
    }
    fn cases(&self) -> Vec<Case> {
        let over = ("ev", Value::Number(1.0));
        ["photographic", "additive"].map(|m| (m, vec![over.clone(), ("method", Value::Text(m.to_owned()))])).to_vec()
    }

    fn run(&self, run: &mut LayerRun<'_>, layer: Layer) -> Layer {
        let over_ev = self.over_ev(&run.context.recorded);
        let entry = match self.method {
            ExposureMethod::Photographic => ShaderEntry::from("photographic"),
            ExposureMethod::Additive => {
                ShaderEntry::from("additive").choose("curve", curve_choice(&run.context.camera.response))
            }
        };
        let [red, green, blue] = self.factors(&run.context.recorded).map(|factor| factor as f32);
        let (share, share_at_0) = shares(run.context, [run.drawn.x0, run.drawn.y0]);
        let spatial = self.spatial_gain(&run.context.recorded).0;
        let uniform = ExposureUniform {
            gain: photographic_gain(over_ev) as f32,
            step: (0.2 * over_ev) as f32,
            picture: photographic_gain(picture_ev(run.context)) as f32,
            gamma: run.context.camera.response.gamma as f32,
            factors: [red, green, blue, 1.0],
            share,
            share_at_0,
            across: std::array::from_fn(|n| std::array::from_fn(|i| spatial[4 * n + i])),
        };
        let samples = response_samples(run.recorder, &run.context.camera.response);
        let pass = run.recorder.pass(Shader::Exposure, entry).uniform("exposure", &uniform);
        let pass = pass.buffer("response_samples", samples);
        let [color] = pass.texture("layer", &layer.color).draw([COLOR], layer.size);
        Layer { color, ..layer }
    }
}

/// Exposes one premultiplied pixel of the layer. The estimated gain of `follow` is applied to its
/// light before.
pub fn twin(rgba: [f64; 4], method: ExposureMethod, over_ev: f64, response: &Response) -> [f64; 4] {
    let [r, g, b, a] = rgba;
    let exposed = |light: f64| match method {
        ExposureMethod::Photographic => light * photographic_gain(over_ev),
        ExposureMethod::Additive if a > 0.0 => a * response.decode(additive(response.encode(light / a), over_ev)),
        ExposureMethod::Additive => 0.0,
    };
    [exposed(r), exposed(g), exposed(b), a]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Curve;
    use crate::frame::{NODES_ACROSS, NODES_DOWN, PhotoSettings};
    use crate::gpu::constant;

    #[test]
    fn constants_equal_the_shaders() {
        let nodes = ["NODES_ACROSS", "NODES_DOWN"].map(|name| constant(&Shader::Exposure.module(), name));
        assert_eq!(nodes, [NODES_ACROSS as f64, NODES_DOWN as f64]);
    }

    #[test]
    fn exposure_by_stops_matches_hand_computed_values() {
        let linear = Response { curve: Curve::Linear, ..Default::default() };
        assert_eq!(twin([0.2, 0.1, 0.0, 0.5], ExposureMethod::Photographic, 2.0, &linear), [0.8, 0.4, 0.0, 0.5]);
        // Half covered, with surface colours of 0.4 and 0.2: one stop adds 0.2 to the display
        // value.
        let [r, g, _, a] = twin([0.2, 0.1, 0.0, 0.5], ExposureMethod::Additive, 1.0, &linear);
        assert!((r - 0.3).abs() < 1e-12 && (g - 0.2).abs() < 1e-12 && a == 0.5);
        assert_eq!(twin([0.2, 0.1, 0.0, 0.5], ExposureMethod::Additive, -5.0, &linear), [0.0, 0.0, 0.0, 0.5]);
    }

    #[test]
    fn exposure_follows_the_recorded_and_the_estimated_exposure() {
        let frame_exposure = |time_s, gain| FrameExposure { time_s, gain, ..Default::default() };
        let params = Exposure { reference_s: Some(0.01), ..Default::default() };
        assert_eq!(params.over_ev(&frame_exposure(Some(0.02), None)), 1.0);
        assert_eq!(params.over_ev(&frame_exposure(Some(0.02), Some(2.0))), 2.0);
        assert_eq!(params.over_ev(&frame_exposure(None, Some(2.0))), 0.0);
        assert_eq!(Exposure::default().over_ev(&frame_exposure(Some(0.02), Some(2.0))), 0.0);
        let params = Exposure { ev: -0.5, ..params };
        assert_eq!(params.over_ev(&frame_exposure(Some(0.04), None)), 1.5);
        // Estimated: the frame is half as bright as the usual one, which was exposed for 20 ms. The
        // recorded exposure is ignored.
        let brightness = Some(crate::frame::RelativeBrightness {
            factors: [0.5, 0.5, 0.4],
            median_s: Some(0.02),
            spatial_gain: SpatialGain::default(),
        });
        let measured = FrameExposure { brightness, ..frame_exposure(Some(0.08), None) };
        let params = Exposure { reference_s: Some(0.01), ..Default::default() };
        assert_eq!((params.over_ev(&measured), params.factors(&measured)), (1.0, [0.5, 0.5, 0.4]));
        let recorded = Exposure { follow: false, ..params };
        assert_eq!((recorded.over_ev(&measured), recorded.factors(&measured)), (3.0, [1.0; 3]));
        // f/4, 1/50 s, ISO 400: 0.02 · 4 / 16 = 5 ms at f/1 and ISO 100.
        let photo = PhotoSettings { time_s: Some(0.02), f_number: Some(4.0), iso: Some(400.0), ..Default::default() };
        assert_eq!(equivalent_exposure_s(&FrameExposure { photo, ..Default::default() }), Some(0.005));
        assert_eq!(equivalent_exposure_s(&frame_exposure(Some(0.0), None)), None);
    }
}
