//! What it costs to change a setting: a frame right after the change, next to the same frame again.

use std::time::Instant;

use super::{INTERVAL_S, Load, Table};
use crate::compositor::{Compositor, Job, Settings, SubmitError, Target};
use crate::frame::{Frame, FrameExposure};
use crate::params::{Kind, Params, Spec, Value};
use crate::pixels::Pixels;
use crate::profile::Rig;

/// Values that a parameter is changed to.
const VALUES: usize = 8;
/// The lens of effects that do nothing behind a pinhole, focused in front of the load's sphere.
const LENS: [&str; 2] = ["camera.lens.f_number=2.8", "camera.lens.focus_distance_m=1.5"];

/// What a window holds while a person moves a slider.
#[derive(Clone)]
struct Held {
    rig: Rig,
    settings: Settings,
}

impl Held {
    fn new(load: &Load) -> Self {
        let mut rig = Rig::default();
        rig.lay_over(&load.geometry);
        rig.noise.clone_from(&load.camera.noise);
        rig.exposure = load.camera.exposure.clone();
        Self { rig, settings: Settings::default() }
    }

    /// Whether that can be set.
    fn set(&mut self, table: &str, name: &str, value: &Value) -> bool {
        self.rig.set_text(&format!("{table}.{name}={value}"), &mut self.settings).is_ok()
    }
}

/// Of so many that seemed to cost most it is measured again which one does: of hundreds one always seems to, by chance.
const AGAIN: usize = 5;

/// Times every parameter of the camera and of every effect, each in all of the effect's ways. Gives a row for the one that
/// costs most by comparison.
pub fn settings(table: &mut Table<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    const CHANGED: &str = "a setting changed";
    const SAME: &str = "the same frame, unchanged";
    if !table.wants(CHANGED) && !table.wants(SAME) {
        return Ok(());
    }
    let by_cost = |all: Vec<Parameter>, table: &Table<'_>| -> Result<Vec<(Parameter, [f64; 2])>, SubmitError> {
        let mut found = Vec::new();
        for parameter in all {
            if let Some(pair) = parameter.time(table, load, pixels)? {
                found.push((parameter, pair));
            }
        }
        let ratio = |[changed, same]: [f64; 2]| changed / same;
        found.sort_by(|(_, a), (_, b)| ratio(*b).total_cmp(&ratio(*a)));
        Ok(found)
    };
    let worst = by_cost(parameters(load), table)?.into_iter().take(AGAIN).map(|(parameter, _)| parameter).collect();
    if let Some((parameter, [changed, same])) = by_cost(worst, table)?.into_iter().next() {
        table.push(format!("{CHANGED}: {}", parameter.name), changed)?;
        table.push(SAME.to_owned(), same)?;
    }
    Ok(())
}

/// A parameter, what a row calls it, and what it is changed in.
struct Parameter {
    name: String,
    table: &'static str,
    spec: Spec,
    held: Held,
}

fn parameters(load: &Load) -> Vec<Parameter> {
    let held = Held::new(load);
    let of = |params: &dyn Params, label: &str, held: &Held| -> Vec<_> {
        let table = params.table();
        let parameter = |spec: Spec| Parameter {
            name: format!("{table}.{} {label}", spec.name).trim_end().to_owned(),
            table,
            spec,
            held: held.clone(),
        };
        params.specs().into_iter().map(parameter).collect()
    };
    let mut all: Vec<_> = held.rig.tables().into_iter().flat_map(|table| of(table, "", &held)).collect();
    for effect in crate::effects::all() {
        for (label, sets) in effect.cases() {
            let mut held = held.clone();
            let known = sets.iter().all(|(name, value)| held.set(effect.table(), name, value));
            assert!(known, "{} {label}", effect.table());
            all.extend(of(effect.as_ref(), label, &held));
        }
    }
    all
}

impl Parameter {
    /// At the value with the median ratio: milliseconds right after the change, and again unchanged. `None` if the parameter
    /// cannot be changed here, or its effect never runs.
    fn time(&self, table: &Table<'_>, load: &Load, pixels: &Pixels) -> Result<Option<[f64; 2]>, SubmitError> {
        if let Some(found) = self.time_in(self.held.clone(), table, load, pixels)? {
            return Ok(Some(found));
        }
        let mut behind_a_lens = self.held.clone();
        for set in LENS {
            let set = behind_a_lens.rig.set_text(set, &mut behind_a_lens.settings);
            assert!(set.is_ok(), "{set:?}");
        }
        self.time_in(behind_a_lens, table, load, pixels)
    }

    fn time_in(
        &self,
        mut held: Held,
        table: &Table<'_>,
        load: &Load,
        pixels: &Pixels,
    ) -> Result<Option<[f64; 2]>, SubmitError> {
        let Self { table: of, spec, .. } = self;
        let mut compositor = Compositor::new(table.gpu.clone(), load.scene.clone());
        let mut pairs = Vec::new();
        let is_effect = held.settings.effects().any(|effect| effect.table() == *of);
        let now = held.rig.tables().into_iter().find(|params| params.table() == *of);
        let now = now.and_then(|params| params.get(spec.name));
        // A choice makes pipelines once: what is timed is the changing back.
        let untimed = if let Kind::Choice(names) = spec.kind { names.len() } else { 2 };
        for (n, value) in values(spec, now.as_ref()).into_iter().enumerate() {
            let mut changed = held.clone();
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
            held = changed;
            let mut runs = true;
            let mut time = || -> Result<f64, SubmitError> {
                let exposure = FrameExposure::default();
                let frame = Frame {
                    index: n,
                    timestamp_s: 0.0,
                    pixels: pixels.clone(),
                    depth: None,
                    exposure,
                    presence: 1.0,
                    beside: Vec::new(),
                    surfels: Default::default(),
                };
                let start = Instant::now();
                let job = Job::of_frame(frame, &camera, &held.settings, &geometry, &load.track, INTERVAL_S)?;
                let pending = compositor.submit(job, &camera, &held.settings, Target::Pixels)?;
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

/// Values as a slider gives them, none of them twice: around what is set now, or else in the lower part of wide ranges;
/// choices in turn.
fn values(spec: &Spec, now: Option<&Value>) -> Vec<Value> {
    let share = |n: usize| (n as f64 + 0.5) / VALUES as f64;
    let from_to = |min: f64, max: f64, most: f64| match now {
        Some(Value::Number(now)) if now.abs() > most => [0.95 * now, 1.05 * now],
        _ => [min.max(-0.5 * most), max.min(min.max(-0.5 * most) + most)],
    };
    let numbers = |[low, high]: [f64; 2]| (0..VALUES).map(move |n| low + (high - low) * share(n));
    match spec.kind {
        Kind::Number { min, max } => numbers(from_to(min, max, 16.0)).map(Value::Number).collect(),
        Kind::Integer { min, max } => numbers(from_to(min, max, 16.0)).map(|n| Value::Number(n.round())).collect(),
        Kind::Choice(names) => {
            (0..VALUES.max(3 * names.len())).map(|n| Value::Text(names[n % names.len()].to_owned())).collect()
        }
        Kind::Bool => (0..VALUES).map(|n| Value::Bool(n % 2 == 0)).collect(),
    }
}
