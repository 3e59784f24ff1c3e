//! Cost of a changed setting: time of the frame right after the change, against the same frame
//! again.

use std::time::Instant;

use super::{BenchTable, INTERVAL_S, Load};
use crate::compositor::{Compositor, Job, Settings, SubmitError, Target};
use crate::frame::{Frame, FrameExposure};
use crate::params::{Kind, Params, Spec, Value};
use crate::pixels::Pixels;
use crate::profile::Rig;

/// Number of values that a parameter is changed to.
const VALUES_PER_PARAMETER: usize = 8;
/// Lens for effects that have no effect with a pinhole, focused in front of the load's sphere.
const LENS: [&str; 2] = ["camera.lens.f_number=2.8", "camera.lens.focus_distance_m=1.5"];

/// Camera and settings, as held by the window during a slider drag.
#[derive(Clone)]
struct BenchSettings {
    rig: Rig,
    settings: Settings,
}

impl BenchSettings {
    fn new(load: &Load) -> Self {
        let mut rig = Rig::default();
        rig.lay_over(&load.geometry);
        rig.noise.clone_from(&load.camera.noise);
        rig.exposure = load.camera.exposure.clone();
        Self { rig, settings: Settings::default() }
    }

    /// Sets a parameter. Returns false if the value is rejected.
    fn set(&mut self, table: &str, name: &str, value: &Value) -> bool {
        self.rig.set_text(&format!("{table}.{name}={value}"), &mut self.settings).is_ok()
    }
}

/// Number of slowest parameters that are measured again, since one of hundreds is always slow by
/// chance.
const REMEASURED: usize = 5;

/// Times every parameter of the camera and of every effect, in all cases of the effect. Adds rows
/// for the one with the largest ratio of changed to unchanged time.
pub fn time(table: &mut BenchTable<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    const CHANGED: &str = "a setting changed";
    const SAME: &str = "the same frame, unchanged";
    if !table.includes(CHANGED) && !table.includes(SAME) {
        return Ok(());
    }
    let by_cost =
        |all: Vec<TimedParameter>, table: &BenchTable<'_>| -> Result<Vec<(TimedParameter, [f64; 2])>, SubmitError> {
            let mut settings = Vec::new();
            for parameter in all {
                if let Some(pair) = parameter.time(table, load, pixels)? {
                    settings.push((parameter, pair));
                }
            }
            let ratio = |[changed, same]: [f64; 2]| changed / same;
            settings.sort_by(|(_, a), (_, b)| ratio(*b).total_cmp(&ratio(*a)));
            Ok(settings)
        };
    let worst =
        by_cost(parameters(load), table)?.into_iter().take(REMEASURED).map(|(parameter, _)| parameter).collect();
    if let Some((parameter, [changed, same])) = by_cost(worst, table)?.into_iter().next() {
        table.push(format!("{CHANGED}: {}", parameter.name), changed)?;
        table.push(SAME.to_owned(), same)?;
    }
    Ok(())
}

/// A parameter with the name of its row and its initial state.
struct TimedParameter {
    name: String,
    table: &'static str,
    spec: Spec,
    state: BenchSettings,
}

fn parameters(load: &Load) -> Vec<TimedParameter> {
    let state = BenchSettings::new(load);
    let timed_parameters = |params: &dyn Params, label: &str, state: &BenchSettings| -> Vec<_> {
        let table = params.table();
        let parameter = |spec: Spec| TimedParameter {
            name: format!("{table}.{} {label}", spec.name).trim_end().to_owned(),
            table,
            spec,
            state: state.clone(),
        };
        params.specs().into_iter().map(parameter).collect()
    };
    let mut all: Vec<_> =
        state.rig.tables().into_iter().flat_map(|table| timed_parameters(table, "", &state)).collect();
    for effect in crate::effects::all() {
        for (label, sets) in effect.cases() {
            let mut state = state.clone();
            let are_set = sets.iter().all(|(name, value)| state.set(effect.table(), name, value));
            assert!(are_set, "{} {label}", effect.table());
            all.extend(timed_parameters(effect.as_ref(), label, &state));
        }
    }
    all
}

impl TimedParameter {
    /// Times of the value with the median ratio, milliseconds: right after the change, and
    /// unchanged. `None` if the parameter cannot be changed with this load, or its effect never
    /// runs.
    fn time(&self, table: &BenchTable<'_>, load: &Load, pixels: &Pixels) -> Result<Option<[f64; 2]>, SubmitError> {
        if let Some(ms) = self.time_in(self.state.clone(), table, load, pixels)? {
            return Ok(Some(ms));
        }
        let mut behind_a_lens = self.state.clone();
        for set in LENS {
            let set = behind_a_lens.rig.set_text(set, &mut behind_a_lens.settings);
            assert!(set.is_ok(), "{set:?}");
        }
        self.time_in(behind_a_lens, table, load, pixels)
    }

    fn time_in(
        &self,
        mut state: BenchSettings,
        table: &BenchTable<'_>,
        load: &Load,
        pixels: &Pixels,
    ) -> Result<Option<[f64; 2]>, SubmitError> {
        let Self { table: of, spec, .. } = self;
        let mut compositor = Compositor::new(table.gpu.clone(), load.scene.clone());
        let mut pairs = Vec::new();
        let is_effect = state.settings.effects().any(|effect| effect.table() == *of);
        let now = state.rig.tables().into_iter().find(|params| params.table() == *of);
        let now = now.and_then(|params| params.get(spec.name));
        // A choice compiles its pipelines once; later changes back to it are timed.
        let untimed = if let Kind::Choice(names) = spec.kind { names.len() } else { 2 };
        for (n, value) in values(spec, now.as_ref()).into_iter().enumerate() {
            let mut changed = state.clone();
            if !changed.set(of, spec.name, &value) {
                continue;
            }
            let camera = changed.rig.camera();
            let Some(geometry) = camera.geometry.clone() else { continue };
            let (width, height) = (geometry.intrinsics.width_px, geometry.intrinsics.height_px);
            let refused =
                changed.settings.check(&camera, &geometry).is_err() || camera.lens.opening(&geometry).is_err();
            if refused || (width, height) != (pixels.width, pixels.height) {
                continue;
            }
            state = changed;
            let mut runs = true;
            let mut time = || -> Result<f64, SubmitError> {
                let exposure = FrameExposure::default();
                let frame = Frame { exposure, ..Frame::new(n, 0.0, pixels.clone()) };
                let start = Instant::now();
                let job = Job::of_frame(frame, &camera, &state.settings, &geometry, &load.track, INTERVAL_S)?;
                let pending = compositor.submit(job, &camera, &state.settings, Target::Pixels)?;
                let done = compositor.collect(pending)?;
                runs &= if is_effect { done.stats.effects.contains(of) } else { done.stats.objects_in_sight };
                Ok(start.elapsed().as_secs_f64() * 1e3)
            };
            let pair = [time()?, time()?];
            if runs && n >= untimed {
                pairs.push(pair);
            }
        }
        pairs.sort_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
        Ok(pairs.get(pairs.len() / 2).copied())
    }
}

/// Distinct values of a slider drag: around the current value, or in the lower part of wide ranges.
/// Choices take turns.
fn values(spec: &Spec, now: Option<&Value>) -> Vec<Value> {
    let share = |n: usize| (n as f64 + 0.5) / VALUES_PER_PARAMETER as f64;
    let from_to = |min: f64, max: f64, span: f64| match now {
        Some(Value::Number(now)) if now.abs() > span => [0.95 * now, 1.05 * now],
        _ => [min.max(-0.5 * span), max.min(min.max(-0.5 * span) + span)],
    };
    let numbers = |[low, high]: [f64; 2]| (0..VALUES_PER_PARAMETER).map(move |n| low + (high - low) * share(n));
    match spec.kind {
        Kind::Number { min, max } => numbers(from_to(min, max, 16.0)).map(Value::Number).collect(),
        Kind::Integer { min, max } => numbers(from_to(min, max, 16.0)).map(|n| Value::Number(n.round())).collect(),
        Kind::Choice(names) => (0..VALUES_PER_PARAMETER.max(3 * names.len()))
            .map(|n| Value::Text(names[n % names.len()].to_owned()))
            .collect(),
        Kind::Bool => (0..VALUES_PER_PARAMETER).map(|n| Value::Bool(n % 2 == 0)).collect(),
        Kind::Points | Kind::LensTable => Vec::new(),
    }
}
