//! Benchmark of the window, run in the window itself: time to the first picture, painting,
//! playback, dragging, and the latency from a changed parameter to its picture. A picture may be a
//! preview first (`RenderKey::is_approximate`).

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::{Duration, Instant};

use eframe::egui;
use glam::DVec3;

use super::picture::PictureView;
use super::project::tables;
use super::session::Session;
use super::{Pace, Player};
use locard_engine::compositor::IN_FLIGHT;
use locard_engine::gpu::Gpu;
use locard_engine::params::{Kind, Value};
use locard_engine::scene::{Entry, ItemPlacement};
use locard_engine::shot::{Shot, ShotError};

/// Duration of the playback and drag steps.
const PLAYBACK_DURATION: Duration = Duration::from_secs(8);
/// Duration of the painting step.
const PAINTING_DURATION: Duration = Duration::from_secs(3);
/// Number of values that each parameter is set to.
const VALUES_PER_PARAMETER: usize = 20;

/// Steps of the benchmark.
enum BenchmarkStep {
    First,
    /// Painting of the window with a static picture.
    Paint,
    /// Playback with or without the panels.
    Play {
        alone: bool,
    },
    /// The first object of the scene moves in a circle, as if dragged.
    Drag,
    Change {
        table: &'static str,
        name: &'static str,
        values: VecDeque<Value>,
    },
}

/// Latencies from a change of a parameter to its picture.
struct ParameterLatency {
    parameter: String,
    worst_s: f64,
    sum_s: f64,
    count: usize,
}

/// Runs the window automatically and prints the results.
pub struct Measure {
    started: Instant,
    /// Frame rate of the same frames without a window, pictures per second.
    without_per_s: f64,
    steps: VecDeque<BenchmarkStep>,
    begun: Option<(Instant, u64)>,
    first_s: Option<f64>,
    /// When a value was set, and whether its picture has been painted.
    set: Option<(Instant, bool)>,
    changes: Vec<ParameterLatency>,
}

impl Measure {
    /// `started`: start of the program. Composites the recording without a window first.
    pub fn new(started: Instant, shot: &Shot) -> Result<Self, ShotError> {
        let failed = |source| ShotError::Gpu { frame: 0, source };
        let mut compositor = shot.compositor(Gpu::open().map_err(failed)?);
        let range = 0..shot.recording.frame_count();
        // The first frame compiles the pipelines.
        shot.frames(&mut compositor, 0..1, false, 1)?.try_for_each(|done| done.map(drop))?;
        let begun = Instant::now();
        let mut count = 0;
        while begun.elapsed() < PLAYBACK_DURATION {
            for done in shot.frames(&mut compositor, range.clone(), false, IN_FLIGHT)? {
                done?;
                count += 1;
            }
        }
        let without_per_s = f64::from(count) / begun.elapsed().as_secs_f64();
        let mut steps = VecDeque::from([
            BenchmarkStep::First,
            BenchmarkStep::Paint,
            BenchmarkStep::Play { alone: false },
            BenchmarkStep::Play { alone: true },
            BenchmarkStep::Drag,
        ]);
        for params in tables(&shot.rig, &shot.settings) {
            let table = params.table();
            for spec in params.specs() {
                if let Some(values) = params.get(spec.name).and_then(|now| values(&spec.kind, &now)) {
                    steps.push_back(BenchmarkStep::Change { table, name: spec.name, values });
                }
            }
        }
        let started = started + begun.elapsed();
        Ok(Self { started, without_per_s, steps, begun: None, first_s: None, set: None, changes: Vec::new() })
    }

    /// Advances the benchmark; call it in each frame of the window. Returns true at the end.
    pub fn step(&mut self, session: &mut Session, view: &mut PictureView, ctx: &egui::Context) -> bool {
        match self.steps.front() {
            None => {
                self.print();
                return true;
            }
            Some(BenchmarkStep::First) => self.wait_for_first_picture(session, ctx),
            Some(BenchmarkStep::Paint) => self.paint(ctx),
            Some(&BenchmarkStep::Play { alone }) => self.play(session, view, ctx, alone),
            Some(BenchmarkStep::Drag) => self.drag(session, ctx),
            Some(BenchmarkStep::Change { .. }) => self.change(session, ctx),
        }
        false
    }

    /// Ends the current step.
    fn end_step(&mut self, ctx: &egui::Context) {
        self.begun = None;
        self.steps.pop_front();
        ctx.request_repaint();
    }

    fn wait_for_first_picture(&mut self, session: &Session, ctx: &egui::Context) {
        let now_s = self.started.elapsed().as_secs_f64();
        if self.first_s.is_none() && session.is_shown() {
            self.first_s = Some(now_s);
        }
        if let Some(first_s) = self.first_s.filter(|_| session.is_settled()) {
            println!("first picture          {first_s:.2} s; whole after {now_s:.2} s");
            self.end_step(ctx);
        }
    }

    /// Paints the unchanged window repeatedly.
    fn paint(&mut self, ctx: &egui::Context) {
        match &mut self.begun {
            None => self.begun = Some((Instant::now(), 0)),
            Some((begun, paints)) if begun.elapsed() > PAINTING_DURATION => {
                let took_s = begun.elapsed().as_secs_f64() / *paints as f64;
                println!("the window itself      {:.1} ms", 1e3 * took_s);
                self.end_step(ctx);
            }
            Some((_, paints)) => *paints += 1,
        }
        ctx.request_repaint();
    }

    /// Plays every frame. `alone`: without panels.
    fn play(&mut self, session: &mut Session, view: &mut PictureView, ctx: &egui::Context, alone: bool) {
        match self.begun {
            None => {
                view.alone = alone;
                session.player.pace = Pace::EveryFrame;
                session.player.play(true);
                self.begun = Some((Instant::now(), session.pictures()));
                ctx.request_repaint();
            }
            Some((begun, pictures)) if begun.elapsed() > PLAYBACK_DURATION => {
                let per_s = (session.pictures() - pictures) as f64 / begun.elapsed().as_secs_f64();
                let share = self.without_per_s / per_s;
                let without = self.without_per_s;
                let without_panels = if alone { ", without panels" } else { "" };
                println!(
                    "playing                {per_s:.1} pictures/s; without a window {without:.1}: {share:.2} times{without_panels}"
                );
                view.alone = false;
                pause(&mut session.player);
                self.end_step(ctx);
            }
            Some(_) => {}
        }
    }

    /// Drags the first piece of evidence.
    fn drag(&mut self, session: &mut Session, ctx: &egui::Context) {
        match self.begun {
            None => {
                self.begun = Some((Instant::now(), session.pictures()));
                ctx.request_repaint();
            }
            Some((begun, pictures))
                if begun.elapsed() > PLAYBACK_DURATION || session.project.edit().scene.objects.is_empty() =>
            {
                let per_s = (session.pictures() - pictures) as f64 / begun.elapsed().as_secs_f64();
                println!("dragging evidence      {per_s:.1} pictures/s");
                session.project.discard_uncommitted();
                self.end_step(ctx);
            }
            Some((begun, _)) => {
                // A circle of 5 cm around its position in two seconds.
                let mut scene = session.project.edit().scene.clone();
                let entry = Entry { object: 0, instance: scene.entries().first().and_then(|first| first.instance) };
                let was = session.project.history().committed().scene.placement(entry);
                if let Some(was) = was {
                    let (sin, cos) = (PI * begun.elapsed().as_secs_f64()).sin_cos();
                    let position_m = was.position_m + 0.05 * DVec3::new(cos, sin, 0.0);
                    scene.put(entry, &ItemPlacement { position_m, ..was });
                    if let Err(error) = session.project.set_uncommitted_scene(scene) {
                        session.show_error(error.to_string());
                    }
                }
                ctx.request_repaint();
            }
        }
    }

    /// Sets one value of the parameter, or waits until the last one is drawn.
    fn change(&mut self, session: &mut Session, ctx: &egui::Context) {
        let Some(BenchmarkStep::Change { table, name, values }) = self.steps.front_mut() else { return };
        let Some((set, is_drawn)) = self.set else {
            let Some(value) = values.pop_front() else {
                session.project.undo();
                return self.end_step(ctx);
            };
            if session.is_settled() {
                let before = session.project.version();
                let done = session.project.set(table, name, &value);
                if done.is_ok() && session.project.version() != before {
                    self.set = Some((Instant::now(), false));
                }
            } else {
                values.push_front(value);
            }
            return ctx.request_repaint();
        };
        if is_drawn {
            let took_s = set.elapsed().as_secs_f64();
            let parameter = format!("{table}.{name}");
            match self.changes.last_mut().filter(|change| change.parameter == parameter) {
                Some(change) => {
                    change.worst_s = change.worst_s.max(took_s);
                    change.sum_s += took_s;
                    change.count += 1;
                }
                // The first change includes one-time work and is not counted.
                None => self.changes.push(ParameterLatency { parameter, worst_s: 0.0, sum_s: 0.0, count: 0 }),
            }
            self.set = None;
            ctx.request_repaint();
        } else if session.is_shown() {
            // The picture is on the screen when the next frame of the window begins.
            self.set = Some((set, true));
            ctx.request_repaint();
        }
    }

    fn print(&mut self) {
        self.changes.retain(|change| change.count > 0);
        self.changes.sort_by(|a, b| b.worst_s.total_cmp(&a.worst_s));
        let (sum_s, count) = self.changes.iter().fold((0.0, 0), |(s, n), c| (s + c.sum_s, n + c.count));
        println!("a changed parameter    {:.0} ms, mean of {count}", 1e3 * sum_s / count.max(1) as f64);
        for ParameterLatency { parameter, worst_s, sum_s, count } in self.changes.iter().take(5) {
            let mean = 1e3 * sum_s / *count as f64;
            println!("  {parameter:<34} {mean:.0} ms, worst of {count} {:.0} ms", 1e3 * worst_s);
        }
    }
}

fn pause(player: &mut Player) {
    player.play(false);
    player.seek(player.count() / 3);
}

/// Values of a slider drag: within a tenth of the value to either side.
fn values(kind: &Kind, now: &Value) -> Option<VecDeque<Value>> {
    let Value::Number(now) = *now else { return None };
    let (min, max, whole) = match *kind {
        Kind::Number { min, max } => (min, max, false),
        Kind::Integer { min, max } => (min, max, true),
        _ => return None,
    };
    let reach = (0.1 * now.abs()).max(0.01 * (max - min).min(10.0));
    let at = |n: usize| now + reach * (2.0 * (n as f64 + 0.5) / VALUES_PER_PARAMETER as f64 - 1.0);
    let rounded = |n: f64| if whole { n.round() } else { n };
    Some((0..=VALUES_PER_PARAMETER).map(|n| Value::Number(rounded(at(n)).clamp(min, max))).collect())
}
