//! The cost of changing a setting: a frame right after the change, against the same frame again.

use std::time::Instant;

use super::{INTERVAL_S, Load, Table};
use crate::camera::Camera;
use crate::compositor::{Compositor, Job, Settings, SubmitError, Target};
use crate::frame::{Frame, FrameExposure};
use crate::params::{Kind, Spec, Value};
use crate::pixels::Pixels;

/// How many values a parameter is changed to.
const VALUES: usize = 8;
/// The lens for effects that do nothing behind a pinhole, focused in front of the load's sphere.
const F_NUMBER: f64 = 2.8;
const FOCUS_M: f64 = 1.5;

/// Times every parameter of every effect in each of the effect's cases. Adds a row for the one with the worst ratio.
pub fn settings(table: &mut Table<'_>, load: &Load, pixels: &Pixels) -> Result<(), SubmitError> {
    let mut worst: Option<(String, [f64; 2])> = None;
    let ratio = |[changed, same]: [f64; 2]| changed / same;
    for effect in crate::effects::all() {
        for (label, sets) in effect.cases() {
            let mut settings = Settings::default();
            let mut set =
                |name: &str, value: &Value| settings.set(effect.table(), name, value).is_some_and(|set| set.is_ok());
            let known = sets.iter().all(|(name, value)| set(name, value));
            debug_assert!(known, "{} {label}", effect.table());
            for spec in effect.specs() {
                let name = format!("{}.{} {label}", effect.table(), spec.name);
                let mut found = of_parameter(table, load, &load.camera, pixels, &settings, effect.table(), &spec)?;
                if found.is_none() {
                    let mut camera = load.camera.clone();
                    camera.lens.f_number = Some(F_NUMBER);
                    camera.lens.focus_distance_m = Some(FOCUS_M);
                    found = of_parameter(table, load, &camera, pixels, &settings, effect.table(), &spec)?;
                }
                if let Some(found) = found
                    && worst.as_ref().is_none_or(|(_, most)| ratio(found) > ratio(*most))
                {
                    worst = Some((name.trim_end().to_owned(), found));
                }
            }
        }
    }
    if let Some((name, [changed, same])) = worst {
        table.push(format!("a setting changed: {name}"), changed)?;
        table.push("the same frame, unchanged".to_owned(), same)?;
    }
    Ok(())
}

/// At the value with the median ratio: milliseconds right after the change, and again unchanged. Values at which the
/// effect does not run are left out. `None` if it never runs with this camera.
fn of_parameter(
    table: &Table<'_>,
    load: &Load,
    camera: &Camera,
    pixels: &Pixels,
    settings: &Settings,
    of: &str,
    spec: &Spec,
) -> Result<Option<[f64; 2]>, SubmitError> {
    let Load { geometry, track, .. } = load;
    let mut compositor = Compositor::new(table.gpu.clone(), load.scene.clone());
    let (mut settings, mut pairs) = (settings.clone(), Vec::new());
    // A choice makes its pipelines once; what is timed is changing back.
    let untimed = if let Kind::Choice(names) = spec.kind { names.len() } else { 2 };
    for (n, value) in values(spec).into_iter().enumerate() {
        if settings.set(of, spec.name, &value).is_none_or(|set| set.is_err()) {
            continue;
        }
        if settings.check(camera, geometry).is_err() {
            continue;
        }
        let mut runs = true;
        let mut time = || -> Result<f64, SubmitError> {
            let exposure = FrameExposure::default();
            let frame = Frame { index: n, timestamp_s: 0.0, pixels: pixels.clone(), depth: None, exposure };
            let start = Instant::now();
            let job = Job::of_frame(frame, camera, &settings, geometry, track, INTERVAL_S)?;
            let pending = compositor.submit(job, camera, &settings, Target::Pixels)?;
            runs &= compositor.collect(pending)?.stats.effects.contains(&of);
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

/// Values as a slider gives them, without repetition, in the lower part of wide ranges. Choices and switches alternate.
fn values(spec: &Spec) -> Vec<Value> {
    let share = |n: usize| (n as f64 + 0.5) / VALUES as f64;
    match spec.kind {
        Kind::Number { min, max } => {
            let (low, high) = (min.max(-8.0), max.min(min.max(-8.0) + 16.0));
            (0..VALUES).map(|n| Value::Number(low + (high - low) * share(n))).collect()
        }
        Kind::Integer { min, max } => {
            let high = max.min(min + 16.0);
            (0..VALUES).map(|n| Value::Number((min + (high - min) * share(n)).round())).collect()
        }
        Kind::Choice(names) => {
            (0..VALUES.max(3 * names.len())).map(|n| Value::Text(names[n % names.len()].to_owned())).collect()
        }
        Kind::Bool => (0..VALUES).map(|n| Value::Bool(n % 2 == 0)).collect(),
    }
}
