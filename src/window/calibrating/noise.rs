//! Noise from plain places.

use std::collections::BTreeSet;
use std::sync::Arc;

use eframe::egui::{self, DragValue, RichText, Ui};

use super::super::background::{Background, Ticket};
use super::super::calibration_messages;
use super::super::fields::typed;
use super::super::matching::curve;
use super::super::plots::{self, Axes, Of};
use super::super::progress;
use super::super::region_picker::{RegionPicker, RegionPrompt, RegionPurpose};
use super::super::session::Session;
use super::parts::{self, Asked, Picked, Verdict};
use locard_engine::calibrate::{
    NoisePoint, PickedError, PickedNoise, PickedRegion, SceneMotion, min_side_px, picked_noise, sigma_over_profile,
};
use locard_engine::camera::NoiseProfile;
use locard_engine::frame::Frame;
use locard_engine::pixels::Rect;
use locard_engine::shot::Shot;
use locard_engine::text::fixed;

/// Frames at rest beyond this many tell little more.
const MOST_FRAMES: usize = 30;

/// From this factor on it is told that places are noisier than the present profile.
const FAR_OVER: f64 = 1.5;

/// How noise is measured: where, and in which frames.
#[derive(Clone, Debug, PartialEq)]
struct NoiseOf {
    places: Vec<Picked>,
    motion: SceneMotion,
    /// At rest: first and last frame. Otherwise each place is looked at in its own.
    frames: [usize; 2],
    present: Option<NoiseProfile>,
}

impl NoiseOf {
    /// Whether the same is measured, whatever the present noise is.
    fn measures_like(&self, other: &Self) -> bool {
        self.places == other.places && self.frames == other.frames && self.motion == other.motion
    }
}

/// What was found. Nothing is said where no place can be used: each says it itself.
#[derive(Clone, Debug, Default)]
struct Found {
    verdicts: Vec<Verdict>,
    noise: Option<Result<PickedNoise, String>>,
}

impl Found {
    fn profile(&self) -> Option<&NoiseProfile> {
        self.noise.as_ref()?.as_ref().ok().map(|noise| &noise.profile)
    }
}

/// The section.
#[derive(Debug)]
pub struct Noise {
    places: Vec<Picked>,
    /// What is said of them, as far as it is known.
    verdicts: Vec<Verdict>,
    at_rest: bool,
    /// Frames at rest, first and last.
    range: [usize; 2],
    measured: Background<NoiseOf, Found>,
    channel: usize,
}

impl Default for Noise {
    fn default() -> Self {
        let (places, verdicts) = Default::default();
        Self { places, verdicts, at_rest: false, range: [0, 9], measured: Background::default(), channel: 1 }
    }
}

impl Noise {
    pub fn marks(&self, frame: usize) -> impl Iterator<Item = (Rect, String)> {
        let is_here = move |of: usize| if self.at_rest { self.covers(frame) } else { of == frame };
        let all = parts::marks("plain", &self.places, &self.verdicts);
        all.filter(move |(of, ..)| is_here(*of)).map(|(_, at, name)| (at, name))
    }

    fn covers(&self, frame: usize) -> bool {
        (self.range[0]..=self.range[1].max(self.range[0])).contains(&frame)
    }

    fn motion(&self) -> SceneMotion {
        if self.at_rest { SceneMotion::Resting } else { SceneMotion::Moving }
    }

    /// What was measured last.
    pub fn points(&self) -> Option<&[Vec<NoisePoint>; 3]> {
        let found = self.measured.last().filter(|_| !self.places.is_empty())?;
        found.noise.as_ref()?.as_ref().ok().map(|noise| &noise.points)
    }

    /// Nobody waits for what is being measured.
    pub fn rest(&mut self) {
        self.measured.rest();
    }

    /// Takes what was picked.
    pub fn answers(&mut self, session: &Session, picker: &mut RegionPicker) {
        if let Some(picked) = parts::answer(picker, RegionPurpose::PlainPlace, session) {
            self.places.push(picked);
            self.verdicts.push(Verdict::Waits);
        }
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, picker: &mut RegionPicker) {
        parts::aside(ui, "Pick places of one colour, dark ones and bright ones: paper, walls, a table.");
        let wanted = RegionPrompt {
            purpose: RegionPurpose::PlainPlace,
            hint: "Drag rectangles over places of one colour, without shadows or texture",
            min_side_px: min_side_px(self.motion()),
            repeats: true,
        };
        picker.button(ui, "Pick plain places", wanted);
        self.frames(ui, session);
        if self.places.is_empty() {
            return;
        }
        let Some(frame) = session.frame().cloned() else { return };
        let of = NoiseOf {
            places: self.places.clone(),
            frames: if self.at_rest { self.range } else { [0; 2] },
            motion: self.motion(),
            present: session.project.edit().rig.noise.clone(),
        };
        // What was taken is the present one then; it is not measured anew.
        let is_same = self.measured.last_key().is_some_and(|last| last.measures_like(&of));
        let found = self.measured.last().cloned().unwrap_or_default();
        let is_taken = is_same && found.profile().is_some_and(|profile| Some(profile) == of.present.as_ref());
        let is_current = is_taken || self.measured.is_of(&of);
        if !session.player.playing && !is_taken {
            let (shot, asked) = (session.project.shot().clone(), of);
            self.measured.want(ui.ctx(), asked.clone(), move |ticket| measure(&shot, &frame, &asked, ticket));
        }
        if is_same {
            self.verdicts.clone_from(&found.verdicts);
        }
        match parts::list(ui, "plain", &self.verdicts) {
            Some(Asked::Show(n)) => session.player.seek(self.places[n].frame),
            Some(Asked::Drop(n)) => {
                self.places.remove(n);
                self.verdicts.remove(n);
            }
            None => {}
        }
        progress::of(ui, "Noise", &self.measured);
        match found.noise {
            Some(Ok(noise)) => _ = ui.add_enabled_ui(is_current, |ui| self.found(ui, session, &noise, is_taken)),
            Some(Err(why)) if is_same => progress::refused(ui, &why),
            _ => {}
        }
    }

    /// In which frames it is looked.
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
                    ui.add(drag.custom_parser(typed(ui.ctx())))
                };
                frame(ui, first).on_hover_text("first frame");
                ui.label("to");
                frame(ui, end).on_hover_text("last frame");
            });
        });
        if self.at_rest != was_at_rest {
            self.verdicts.fill(Verdict::Waits);
        }
    }

    fn found(&mut self, ui: &mut Ui, session: &mut Session, found: &PickedNoise, is_taken: bool) {
        let present = session.project.edit().rig.noise.clone();
        ui.horizontal(|ui| {
            plots::choose_channel(ui, &mut self.channel);
        });
        let (c, colors) = (self.channel, [Of::Profile, Of::Real, Of::Virtual].map(|of| of.color(ui)));
        let (before, points, after) =
            (present.as_ref().map(|p| curve(p, c)), found.points[c].clone(), curve(&found.profile, c));
        let axes = Axes {
            name: "Measured noise",
            x: "code value",
            y: "σ, codes",
            x_range: Some([0.0, 255.0]),
            y_from: Some(0.0),
        };
        plots::show(ui, &axes, move |plot| {
            if let Some(before) = before {
                plot.line(plots::line("present", before, colors[0]));
            }
            plot.line(plots::line("taken", after, colors[2]));
            plots::noise(plot, "measured", &points, colors[1]);
        });
        plots::legend(ui, &[(Of::Profile, "present"), (Of::Real, "measured"), (Of::Virtual, "if it is taken")]);
        egui::Grid::new("measured noise").num_columns(4).spacing([14.0, 2.0]).show(ui, |ui| {
            for head in ["code", "measured σ", "95 %", "present σ"] {
                ui.label(RichText::new(head).small().weak());
            }
            ui.end_row();
            for point in &found.points[c] {
                ui.label(fixed(point.code, 0));
                ui.label(fixed(point.sigma, 2));
                ui.label(point.sigma_ci95.map(|end| fixed(end, 2)).join(" to "));
                ui.label(present.as_ref().map_or("none".to_owned(), |p| fixed(p.sigma(c, point.code), 2)));
                ui.end_row();
            }
        });
        let [low, high] = found.covered();
        let beyond =
            if present.is_some() { "the present curve goes on, scaled to meet it" } else { "it stays as at the ends" };
        let text = format!("Measured from code {} to {}; beyond, {beyond}.", fixed(low, 0), fixed(high, 0));
        ui.label(RichText::new(text).small());
        let used = self.verdicts.iter().enumerate().filter(|(_, verdict)| matches!(verdict, Verdict::Good(_)));
        let used: Vec<usize> = used.map(|(n, _)| n + 1).collect();
        found.warnings.iter().for_each(|warning| parts::aside(ui, calibration_messages::noise_warning(warning, &used)));
        if let Some(over) = present.as_ref().and_then(|present| far_over(&found.points, present)) {
            let text = format!(
                "These places show {} times the noise that the present profile has there. Texture, shadows and dirt count as noise \
                 here: look at them enlarged, and take this only if they are plain.",
                fixed(over, 1)
            );
            ui.label(RichText::new(text).color(ui.visuals().warn_fg_color));
        }
        match parts::take_or_leave(ui, "noise", is_taken) {
            Some(true) => {
                session.project.set_noise(found.profile.clone());
                session.show_message("Taken: the noise that was measured");
            }
            Some(false) => {
                self.places.clear();
                self.verdicts.clear();
                self.measured.clear();
            }
            None => {}
        }
    }
}

/// By how much places are noisier than a profile has it, where that is more than cameras of a kind differ.
fn far_over(points: &[Vec<NoisePoint>; 3], present: &NoiseProfile) -> Option<f64> {
    let over = (0..3).filter_map(|c| sigma_over_profile(&points[c], present, c)).fold(0.0, f64::max);
    Some(over).filter(|over| *over > FAR_OVER)
}

fn measure(shot: &Shot, shown: &Arc<Frame>, of: &NoiseOf, ticket: &Ticket) -> Found {
    let failed = |why: String| Found {
        verdicts: vec![Verdict::Waits; of.places.len()],
        noise: Some(Err(why)).filter(|_| !ticket.is_cancelled()),
    };
    let places = match read(shot, shown, of, ticket) {
        Ok(places) => places,
        Err(why) => return failed(why),
    };
    let found = picked_noise(&places, of.motion, of.present.as_ref());
    let verdict = |n: usize| match found.places.get(n) {
        Some(Ok(code)) => Verdict::Good(format!("used, code {}", fixed(*code, 0))),
        Some(Err(why)) => Verdict::Bad(why.to_string()),
        None => Verdict::Waits,
    };
    let noise = match found.noise {
        Err(PickedError::NoneFit) => None,
        noise => Some(noise.map_err(|error| calibration_messages::picked_error(&error))),
    };
    Found { verdicts: (0..of.places.len()).map(verdict).collect(), noise }
}

/// The places with what their frames show. Each frame is decoded once, and of its pixels no others are held.
fn read(shot: &Shot, shown: &Frame, of: &NoiseOf, ticket: &Ticket) -> Result<Vec<PickedRegion>, String> {
    let [first, last] = of.frames;
    let wanted: BTreeSet<usize> = match of.motion {
        SceneMotion::Resting => {
            (first..(last.max(first) + 1).min(shot.recording.frame_count()).min(first + MOST_FRAMES)).collect()
        }
        SceneMotion::Moving => of.places.iter().map(|place| place.frame).collect(),
    };
    let mut places: Vec<PickedRegion> = of.places.iter().map(|place| PickedRegion::new(place.at)).collect();
    for (n, frame) in wanted.iter().enumerate() {
        if ticket.is_cancelled() {
            return Err(String::new());
        }
        let read = if shown.index == *frame { None } else { Some(shot.read(*frame).map_err(|e| e.to_string())?) };
        let pixels = &read.as_ref().unwrap_or(shown).pixels;
        for (place, picked) in places.iter_mut().zip(&of.places) {
            if of.motion == SceneMotion::Resting || picked.frame == *frame {
                place.add(pixels).map_err(|error| calibration_messages::picked_error(&error))?;
            }
        }
        ticket.done((n + 1) as f64 / wanted.len() as f64);
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::camera::NoiseBin;

    #[test]
    fn places_that_are_far_noisier_than_the_profile_are_told() {
        let bins = [0, 1, 2].map(|_| vec![NoiseBin { code: 100.0, sigma: 2.0 }]);
        let present = NoiseProfile { bins, channel_correlation: [0.0; 3], neighbour_correlation: [0.0; 2] };
        let point = |sigma| NoisePoint { code: 100.0, sigma, sigma_ci95: [sigma; 2], independent_count: 500.0 };
        let points = |sigma| [vec![point(2.0)], vec![point(sigma)], vec![point(2.0)]];
        assert_eq!(far_over(&points(2.9), &present), None);
        assert_eq!(far_over(&points(5.0), &present), Some(2.5));
    }
}
