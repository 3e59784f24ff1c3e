//! Noise from uniform areas.

use std::collections::BTreeSet;
use std::sync::Arc;

use eframe::egui::{self, DragValue, RichText, Ui};

use super::super::background::Background;
use super::super::calibration_messages;
use super::super::fields::typed_parser;
use super::super::matching::curve;
use super::super::plots::{self, Axes, DataSource};
use super::super::progress;
use super::super::region_picker::{RegionPrompt, RegionPurpose};
use super::super::session::Session;
use super::super::task::TaskControl;
use super::super::tool::ToolStack;
use super::parts::{self, Decision, FrameRegion, ListAction, RegionVerdict};
use locard_engine::calibrate::{
    NoisePoint, PickedError, PickedNoise, PickedRegion, SceneMotion, min_side_px, picked_noise, sigma_over_profile,
};
use locard_engine::camera::NoiseProfile;
use locard_engine::frame::Frame;
use locard_engine::pixels::Rect;
use locard_engine::shot::Shot;
use locard_engine::text::fixed;

/// Largest number of frames at rest; more add little information.
const MAX_FRAMES: usize = 30;

/// Ratio of measured to current noise above which a warning is shown.
const EXCESS_NOISE_RATIO: f64 = 1.5;

/// Inputs of a noise measurement.
#[derive(Clone, Debug, PartialEq)]
struct NoiseRequest {
    places: Vec<FrameRegion>,
    motion: SceneMotion,
    /// First and last frame at rest. Otherwise each region is measured in its own frame.
    frames: [usize; 2],
    present: Option<NoiseProfile>,
}

impl NoiseRequest {
    /// True if both measure the same, regardless of the current noise.
    fn measures_like(&self, other: &Self) -> bool {
        self.places == other.places && self.frames == other.frames && self.motion == other.motion
    }
}

/// Result of a measurement. `noise` is `None` if no region is usable; the verdicts have the
/// reasons.
#[derive(Clone, Debug, Default)]
struct NoiseResult {
    verdicts: Vec<RegionVerdict>,
    noise: Option<Result<PickedNoise, String>>,
}

impl NoiseResult {
    fn profile(&self) -> Option<&NoiseProfile> {
        self.noise.as_ref()?.as_ref().ok().map(|noise| &noise.profile)
    }
}

/// The section.
#[derive(Debug)]
pub struct NoisePanel {
    places: Vec<FrameRegion>,
    /// Verdicts of the regions.
    verdicts: Vec<RegionVerdict>,
    at_rest: bool,
    /// Frames at rest, first and last.
    range: [usize; 2],
    measured: Background<NoiseRequest, NoiseResult>,
    channel: usize,
}

impl Default for NoisePanel {
    fn default() -> Self {
        let (places, verdicts) = Default::default();
        Self { places, verdicts, at_rest: false, range: [0, 9], measured: Background::default(), channel: 1 }
    }
}

impl NoisePanel {
    pub fn marks(&self, frame: usize) -> impl Iterator<Item = (Rect, String)> {
        let is_here = move |of: usize| if self.at_rest { self.covers(frame) } else { of == frame };
        let all = parts::marks("area", &self.places, &self.verdicts);
        all.filter(move |(of, ..)| is_here(*of)).map(|(_, at, name)| (at, name))
    }

    fn covers(&self, frame: usize) -> bool {
        (self.range[0]..=self.range[1].max(self.range[0])).contains(&frame)
    }

    fn motion(&self) -> SceneMotion {
        if self.at_rest { SceneMotion::Resting } else { SceneMotion::Moving }
    }

    /// Last measured noise points.
    pub fn points(&self) -> Option<&[Vec<NoisePoint>; 3]> {
        let measured = self.measured.last().filter(|_| !self.places.is_empty())?;
        measured.noise.as_ref()?.as_ref().ok().map(|noise| &noise.points)
    }

    /// Cancels a running measurement.
    pub fn cancel(&mut self) {
        self.measured.cancel();
    }

    /// Takes a newly picked region.
    pub fn take_picked(&mut self, session: &Session, tools: &mut ToolStack) {
        if let Some(picked) = parts::answer(tools, RegionPurpose::PlainPlace, session) {
            self.places.push(picked);
            self.verdicts.push(RegionVerdict::Waits);
        }
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, tools: &mut ToolStack) {
        parts::aside(ui, "Pick places of one colour, dark ones and bright ones: paper, walls, a table.");
        let prompt = RegionPrompt {
            purpose: RegionPurpose::PlainPlace,
            hint: "Drag rectangles over places of one colour, without shadows or texture",
            min_side_px: min_side_px(self.motion()),
            repeats: true,
        };
        tools.region_button(ui, "Pick uniform areas", prompt);
        self.frames(ui, session);
        if self.places.is_empty() {
            return;
        }
        let Some(frame) = session.frame().cloned() else { return };
        let of = NoiseRequest {
            places: self.places.clone(),
            frames: if self.at_rest { self.range } else { [0; 2] },
            motion: self.motion(),
            present: session.project.edit().rig.noise.clone(),
        };
        // Once accepted, the result is the current noise; it is not measured again.
        let is_same = self.measured.last_key().is_some_and(|last| last.measures_like(&of));
        let results = self.measured.last().cloned().unwrap_or_default();
        let is_applied = is_same && results.profile().is_some_and(|profile| Some(profile) == of.present.as_ref());
        let is_current = is_applied || self.measured.is_of(&of);
        if !session.player.playing && !is_applied {
            let (shot, request) = (session.project.shot().clone(), of);
            self.measured.request(ui.ctx(), request.clone(), move |control| measure(&shot, &frame, &request, control));
        }
        if is_same {
            self.verdicts.clone_from(&results.verdicts);
        }
        match parts::list(ui, "area", &self.verdicts) {
            Some(ListAction::Show(n)) => session.player.seek(self.places[n].frame),
            Some(ListAction::Drop(n)) => {
                self.places.remove(n);
                self.verdicts.remove(n);
            }
            None => {}
        }
        progress::of(ui, "Noise", &self.measured);
        match results.noise {
            Some(Ok(noise)) => _ = ui.add_enabled_ui(is_current, |ui| self.result(ui, session, &noise, is_applied)),
            Some(Err(why)) if is_same => progress::refused(ui, &why),
            _ => {}
        }
    }

    /// Choice of the frames to measure.
    fn frames(&mut self, ui: &mut Ui, session: &Session) {
        let last = session.project.shot().recording.frame_count().saturating_sub(1);
        let was_at_rest = self.at_rest;
        ui.horizontal(|ui| {
            ui.radio_value(&mut self.at_rest, false, "each in its frame");
            ui.radio_value(&mut self.at_rest, true, "in frames at rest:");
            ui.add_enabled_ui(self.at_rest, |ui| {
                let [first, end] = &mut self.range;
                let frame = |ui: &mut Ui, at: &mut usize| {
                    let drag = DragValue::new(at).range(0..=last).update_while_editing(false);
                    ui.add(drag.custom_parser(typed_parser(ui.ctx())))
                };
                frame(ui, first).on_hover_text("first frame");
                ui.label("to");
                frame(ui, end).on_hover_text("last frame");
            });
        });
        if self.at_rest != was_at_rest {
            self.verdicts.fill(RegionVerdict::Waits);
        }
    }

    fn result(&mut self, ui: &mut Ui, session: &mut Session, measured: &PickedNoise, is_applied: bool) {
        let present = session.project.edit().rig.noise.clone();
        ui.horizontal(|ui| {
            plots::choose_channel(ui, &mut self.channel);
        });
        let (c, colors) =
            (self.channel, [DataSource::Profile, DataSource::Real, DataSource::Virtual].map(|of| of.color(ui)));
        let (before, points, after) =
            (present.as_ref().map(|p| curve(p, c)), measured.points[c].clone(), curve(&measured.profile, c));
        let axes = Axes {
            name: "Measured noise",
            x: "pixel value (8 bit)",
            y: "noise σ",
            x_range: Some([0.0, 255.0]),
            y_from: Some(0.0),
        };
        plots::show(ui, &axes, move |plot| {
            if let Some(before) = before {
                plot.line(plots::line("current", before, colors[0]));
            }
            plot.line(plots::line("applied", after, colors[2]));
            plots::noise(plot, "measured", &points, colors[1]);
        });
        plots::legend(
            ui,
            &[(DataSource::Profile, "current"), (DataSource::Real, "measured"), (DataSource::Virtual, "if applied")],
        );
        egui::Grid::new("measured noise").num_columns(4).spacing([14.0, 2.0]).show(ui, |ui| {
            for head in ["pixel value", "measured σ", "95 %", "current σ"] {
                ui.label(RichText::new(head).small().weak());
            }
            ui.end_row();
            for point in &measured.points[c] {
                ui.label(fixed(point.code, 0));
                ui.label(fixed(point.sigma, 2));
                ui.label(point.sigma_ci95.map(|end| fixed(end, 2)).join(" to "));
                ui.label(present.as_ref().map_or("none".to_owned(), |p| fixed(p.sigma(c, point.code), 2)));
                ui.end_row();
            }
        });
        let [low, high] = measured.covered();
        let beyond = if present.is_some() { "the current curve continues, scaled" } else { "the end values are used" };
        let text = format!("Measured from pixel value {} to {}; beyond, {beyond}.", fixed(low, 0), fixed(high, 0));
        ui.label(RichText::new(text).small());
        let used = self.verdicts.iter().enumerate().filter(|(_, verdict)| matches!(verdict, RegionVerdict::Good(_)));
        let used: Vec<usize> = used.map(|(n, _)| n + 1).collect();
        measured
            .warnings
            .iter()
            .for_each(|warning| parts::aside(ui, calibration_messages::noise_warning(warning, &used)));
        if let Some(over) = present.as_ref().and_then(|present| excess_noise_ratio(&measured.points, present)) {
            let text = format!(
                "These places show {} times the noise that the current profile has there. Texture, shadows and dirt \
                 count as noise here: look at them enlarged, and use this only if they are uniform.",
                fixed(over, 1)
            );
            ui.label(RichText::new(text).color(ui.visuals().warn_fg_color));
        }
        match parts::apply_or_discard(ui, "noise", is_applied) {
            Some(Decision::Apply) => {
                let had_example = present.is_some_and(|present| present.example.is_some());
                session.project.set_noise(measured.profile.clone());
                session.show_message(if had_example {
                    "The measured noise is in use. Noise by example is not drawn any more: the examples were not measured \
                     here. `locard calibrate noise` makes new ones."
                } else {
                    "The measured noise is in use"
                });
            }
            Some(Decision::Discard) => {
                self.places.clear();
                self.verdicts.clear();
                self.measured.clear();
            }
            None => {}
        }
    }
}

/// Ratio of measured noise to a profile's, if it exceeds the spread between cameras of a kind.
fn excess_noise_ratio(points: &[Vec<NoisePoint>; 3], present: &NoiseProfile) -> Option<f64> {
    let over = (0..3).filter_map(|c| sigma_over_profile(&points[c], present, c)).fold(0.0, f64::max);
    Some(over).filter(|over| *over > EXCESS_NOISE_RATIO)
}

fn measure(shot: &Shot, shown: &Arc<Frame>, of: &NoiseRequest, control: &TaskControl) -> NoiseResult {
    let failed = |why: String| NoiseResult {
        verdicts: vec![RegionVerdict::Waits; of.places.len()],
        noise: Some(Err(why)).filter(|_| !control.is_cancelled()),
    };
    let places = match read(shot, shown, of, control) {
        Ok(places) => places,
        Err(why) => return failed(why),
    };
    let measured = picked_noise(&places, of.motion, of.present.as_ref());
    let verdict = |n: usize| match measured.places.get(n) {
        Some(Ok(code)) => RegionVerdict::Good(format!("used, pixel value {}", fixed(*code, 0))),
        Some(Err(why)) => RegionVerdict::Bad(why.to_string()),
        None => RegionVerdict::Waits,
    };
    let noise = match measured.noise {
        Err(PickedError::NoneFit) => None,
        noise => Some(noise.map_err(|error| calibration_messages::picked_error(&error))),
    };
    NoiseResult { verdicts: (0..of.places.len()).map(verdict).collect(), noise }
}

/// Reads the pixels of the regions. Each frame is decoded once, and only the regions' pixels are
/// kept.
fn read(shot: &Shot, shown: &Frame, of: &NoiseRequest, control: &TaskControl) -> Result<Vec<PickedRegion>, String> {
    let [first, last] = of.frames;
    let frames: BTreeSet<usize> = match of.motion {
        SceneMotion::Resting => {
            (first..(last.max(first) + 1).min(shot.recording.frame_count()).min(first + MAX_FRAMES)).collect()
        }
        SceneMotion::Moving => of.places.iter().map(|place| place.frame).collect(),
    };
    let mut places: Vec<PickedRegion> = of.places.iter().map(|place| PickedRegion::new(place.at)).collect();
    for (n, frame) in frames.iter().enumerate() {
        if control.is_cancelled() {
            return Err(String::new());
        }
        let read = if shown.index == *frame { None } else { Some(shot.read(*frame).map_err(|e| e.to_string())?) };
        let pixels = &read.as_ref().unwrap_or(shown).pixels;
        for (place, picked) in places.iter_mut().zip(&of.places) {
            if of.motion == SceneMotion::Resting || picked.frame == *frame {
                place.add(pixels).map_err(|error| calibration_messages::picked_error(&error))?;
            }
        }
        control.set_progress((n + 1) as f64 / frames.len() as f64);
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::camera::NoiseBin;

    #[test]
    fn excess_noise_of_regions_is_reported() {
        let bins = [0, 1, 2].map(|_| vec![NoiseBin { code: 100.0, sigma: 2.0 }]);
        let present =
            NoiseProfile { example: None, bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] };
        let point = |sigma| NoisePoint { code: 100.0, sigma, sigma_ci95: [sigma; 2], independent_count: 500.0 };
        let points = |sigma| [vec![point(2.0)], vec![point(sigma)], vec![point(2.0)]];
        assert_eq!(excess_noise_ratio(&points(2.9), &present), None);
        assert_eq!(excess_noise_ratio(&points(5.0), &present), Some(2.5));
    }
}
