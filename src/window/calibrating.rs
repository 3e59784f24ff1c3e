//! Calibration from inside: plain places give the noise, edges the sharpness. Each result stands beside the present value, and
//! is taken or left.

use std::sync::Arc;

use eframe::egui::{self, DragValue, RichText, Ui};

use super::analysis::moved_px;
use super::background::{Background, Ticket};
use super::hand::{self, Hand, Purpose};
use super::matching::{curve, draw_edge, width_of};
use super::plots::{self, Axes, Of};
use super::progress::{self, refused};
use super::session::Session;
use crate::calibrate::sharpness::{self, PARAMETER, together};
use crate::calibrate::{NoisePoint, PickedNoise, PickedPlaces, SceneMotion};
use crate::camera::NoiseProfile;
use crate::frame::Frame;
use crate::measure::slanted::SlantedEdge;
use crate::params::Value;
use crate::pixels::Rect;
use crate::recording::Recording;
use crate::shot::Shot;
use crate::words::{count, fixed};

/// Frames at rest beyond this many tell little more.
const MOST_FRAMES: usize = 30;

/// Of each edge its width and its way while the shutter was open, px, or why there is none.
type Edges = Vec<Result<(SlantedEdge, [f64; 2]), String>>;
/// An edge's place with the frame that it was picked in.
type EdgePlace = (usize, Rect);

/// How noise is measured: where, and in which frames.
#[derive(Clone, Debug, PartialEq)]
struct NoiseOf {
    places: Vec<Rect>,
    /// First and last frame.
    frames: [usize; 2],
    motion: SceneMotion,
    present: Option<NoiseProfile>,
}

impl NoiseOf {
    /// Whether the same is measured, whatever the present noise is.
    fn measures_like(&self, other: &Self) -> bool {
        self.places == other.places && self.frames == other.frames && self.motion == other.motion
    }
}

/// The tab.
#[derive(Debug)]
pub struct Calibrating {
    places: Vec<Rect>,
    at_rest: bool,
    /// Frames at rest, first and last.
    range: [usize; 2],
    noise: Background<NoiseOf, Result<PickedNoise, String>>,
    channel: usize,
    edges: Vec<EdgePlace>,
    sharpness: Background<(Vec<EdgePlace>, u64), Edges>,
}

impl Default for Calibrating {
    fn default() -> Self {
        Self {
            places: Vec::new(),
            at_rest: false,
            range: [0, 9],
            noise: Background::default(),
            channel: 1,
            edges: Vec::new(),
            sharpness: Background::default(),
        }
    }
}

impl Calibrating {
    /// The places that were picked.
    pub fn marks(&self) -> impl Iterator<Item = (Rect, String)> {
        let places = self.places.iter().enumerate().map(|(n, place)| (*place, format!("plain {}", n + 1)));
        places.chain(self.edges.iter().enumerate().map(|(n, (_, edge))| (*edge, format!("edge {}", n + 1))))
    }

    /// The noise of the places that were picked, as it was measured last.
    pub fn points(&self) -> Option<&[Vec<NoisePoint>; 3]> {
        let found = self.noise.last().filter(|_| !self.places.is_empty())?;
        found.as_ref().ok().map(|found| &found.points)
    }

    /// Nobody waits for what is being measured.
    pub fn rest(&mut self) {
        self.noise.rest();
        self.sharpness.rest();
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, hand: &mut Hand) {
        let picked = |places: Vec<glam::DVec2>| hand::rect(&places);
        if let Some(place) = hand.answer(Purpose::PlainPlace).and_then(picked) {
            self.places.push(place);
        }
        if let Some(edge) = hand.answer(Purpose::Edge).and_then(picked) {
            self.edges.extend(session.frame().map(|frame| (frame.index, edge)));
        }
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let open = |title: &str| egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(true);
            open("Noise, from plain places").show(ui, |ui| self.noise(ui, session, hand));
            ui.separator();
            open("Sharpness, from edges").show(ui, |ui| self.sharpness(ui, session, hand));
        });
    }

    fn noise(&mut self, ui: &mut Ui, session: &mut Session, hand: &mut Hand) {
        ui.label(
            RichText::new("Pick places of one colour, dark ones and bright ones: paper, walls, a table.")
                .small()
                .weak(),
        );
        ui.horizontal(|ui| {
            if ui.button("Pick a plain place").clicked() {
                let hint = "Drag a rectangle over a place of one colour, without shadows or texture";
                hand.ask(Purpose::PlainPlace, hint);
            }
            list(ui, "place", &mut self.places);
        });
        let last = session.project.shot().recording.frame_count().saturating_sub(1);
        ui.horizontal(|ui| {
            ui.radio_value(&mut self.at_rest, false, "in this frame");
            ui.radio_value(&mut self.at_rest, true, "frames at rest:");
            ui.add_enabled_ui(self.at_rest, |ui| {
                let [first, end] = &mut self.range;
                ui.add(DragValue::new(first).range(0..=last)).on_hover_text("first frame");
                ui.label("to");
                ui.add(DragValue::new(end).range(0..=last)).on_hover_text("last frame");
            });
        });
        if self.places.is_empty() {
            return;
        }
        let Some(frame) = session.frame().cloned() else { return };
        let of = NoiseOf {
            places: self.places.clone(),
            frames: if self.at_rest { self.range } else { [frame.index; 2] },
            motion: if self.at_rest { SceneMotion::Resting } else { SceneMotion::Moving },
            present: session.project.edit().rig.noise.clone(),
        };
        // What was taken is the present one then; it is not measured anew.
        let is_same = self.noise.last_key().is_some_and(|last| last.measures_like(&of));
        let is_taken =
            is_same && matches!(self.noise.last(), Some(Ok(found)) if Some(&found.profile) == of.present.as_ref());
        let is_current = is_taken || self.noise.is_of(&of);
        if !session.player.playing && !is_taken {
            let (recording, asked) = (Arc::clone(&session.project.shot().recording), of.clone());
            self.noise.want(ui.ctx(), of.clone(), move |ticket| measure(&recording, &frame, &asked, ticket));
        }
        progress::of(ui, "Noise", &self.noise);
        match self.noise.last() {
            Some(Ok(found)) => {
                let found = found.clone();
                ui.add_enabled_ui(is_current, |ui| self.found_noise(ui, session, &found, is_taken));
            }
            Some(Err(why)) => refused(ui, why),
            None => {}
        }
    }

    fn found_noise(&mut self, ui: &mut Ui, session: &mut Session, found: &PickedNoise, is_taken: bool) {
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
        let text = format!(
            "Measured from code {} to {}, in {}; beyond, {beyond}.",
            fixed(low, 0),
            fixed(high, 0),
            count(found.frames, "frame")
        );
        ui.label(RichText::new(text).small());
        for warning in &found.warnings {
            ui.label(RichText::new(warning).small().weak());
        }
        match take_or_leave(ui, "noise", is_taken) {
            Some(true) => {
                session.project.set_noise(found.profile.clone());
                session.say("Taken: the noise that was measured");
            }
            Some(false) => {
                self.places.clear();
                self.noise.clear();
            }
            None => {}
        }
    }

    fn sharpness(&mut self, ui: &mut Ui, session: &mut Session, hand: &mut Hand) {
        ui.label(
            RichText::new("Pick straight edges between two plain places, in focus, best while the camera rests.")
                .small()
                .weak(),
        );
        ui.horizontal(|ui| {
            if ui.button("Pick an edge").clicked() {
                let hint = "Drag a rectangle that one straight edge crosses from side to side";
                hand.ask(Purpose::Edge, hint);
            }
            list(ui, "edge", &mut self.edges);
        });
        if self.edges.is_empty() {
            return;
        }
        if !session.player.playing {
            // The camera's response and motion count, and they are settings.
            let (shot, places) = (session.project.shot().clone(), self.edges.clone());
            let key = (places.clone(), session.project.version());
            self.sharpness.want(ui.ctx(), key, move |ticket| measure_edges(&shot, &places, ticket));
        }
        progress::of(ui, "Sharpness", &self.sharpness);
        let Some(found) = self.sharpness.last().cloned() else { return };
        let good: Vec<SlantedEdge> = found.iter().filter_map(|edge| Some(edge.as_ref().ok()?.0.clone())).collect();
        if !good.is_empty() {
            let (edges, color) = (good.clone(), Of::Real.color(ui));
            let axes = Axes {
                name: "Measured edges",
                x: "distance, px",
                y: "% of the step",
                x_range: Some([-3.0, 3.0]),
                y_from: Some(0.0),
            };
            plots::show(ui, &axes, move |plot| edges.iter().for_each(|edge| draw_edge(plot, "edge", edge, color)));
        }
        for (n, edge) in found.iter().enumerate() {
            match edge {
                Ok((edge, moved)) => {
                    ui.label(RichText::new(format!("edge {}: {}", n + 1, width_of(edge))).small());
                    for note in sharpness::notes(edge, *moved) {
                        ui.label(RichText::new(note).small().weak());
                    }
                }
                Err(why) => refused(ui, &format!("edge {}: {why}", n + 1)),
            }
        }
        let Some(all) = together(&good) else { return };
        let (table, name) = PARAMETER;
        let taken = Value::Number((1e3 * all.sigma_px).round() / 1e3);
        let present = session.project.value(table, name);
        let of_present = present.as_ref().map_or(String::new(), ToString::to_string);
        ui.label(format!(
            "measured {} ± {} px, present {of_present} px",
            fixed(all.sigma_px, 3),
            fixed(all.uncertainty_px, 3)
        ));
        if all.between_px > 0.0 {
            let text = "The edges differ by more than chance: what is round, out of focus or moves is softer. The sharpest tell most.";
            ui.label(RichText::new(text).small().weak());
        }
        match take_or_leave(ui, "sharpness", present.as_ref() == Some(&taken)) {
            Some(true) => match session.project.set(table, name, &taken) {
                Ok(()) => {
                    session.project.close_step();
                    session.say("Taken: the sharpness that was measured");
                }
                Err(error) => session.say(error.to_string()),
            },
            Some(false) => {
                self.edges.clear();
                self.sharpness.clear();
            }
            None => {}
        }
    }
}

/// The places that were picked; each can be dropped again.
fn list<T>(ui: &mut Ui, what: &str, places: &mut Vec<T>) {
    if places.is_empty() {
        return;
    }
    ui.label(count(places.len(), what));
    if ui.small_button(format!("drop the last {what}")).clicked() {
        places.pop();
    }
}

/// Whether what was measured is taken, or left.
fn take_or_leave(ui: &mut Ui, what: &str, is_taken: bool) -> Option<bool> {
    ui.horizontal(|ui| {
        if is_taken {
            ui.weak("taken");
        }
        let take = ui.add_enabled(!is_taken, egui::Button::new(format!("Take the {what}")));
        let leave = ui.button(format!("Leave the {what}"));
        match (take.clicked(), leave.clicked()) {
            (true, _) => Some(true),
            (_, true) => Some(false),
            _ => None,
        }
    })
    .inner
}

/// Of the frames the pixels of the places alone are held.
fn measure(recording: &Recording, shown: &Frame, of: &NoiseOf, ticket: &Ticket) -> Result<PickedNoise, String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let [first, last] = of.frames;
    let mut picked = PickedPlaces::new(&of.places);
    if of.motion == SceneMotion::Moving {
        picked.add(&shown.pixels).map_err(|error| told(&error))?;
    } else {
        let range = first..(last.max(first) + 1).min(recording.frame_count()).min(first + MOST_FRAMES);
        let length = range.len().max(1) as f64;
        for (n, frame) in recording.frames(range).map_err(|error| told(&error))?.enumerate() {
            if ticket.is_cancelled() {
                return Err(String::new());
            }
            picked.add(&frame.map_err(|error| told(&error))?.pixels).map_err(|error| told(&error))?;
            ticket.done((n + 1) as f64 / length);
        }
    }
    picked.noise(of.motion, of.present.as_ref()).map_err(|error| told(&error))
}

fn measure_edges(shot: &Shot, places: &[EdgePlace], ticket: &Ticket) -> Edges {
    let response = shot.camera().response;
    let edge = |(n, (frame, region)): (usize, &EdgePlace)| {
        let frame = shot.read(*frame).map_err(|error| error.to_string())?;
        let moved = moved_px(shot, &frame, *region);
        let edge = sharpness::edge(&frame.pixels, &response, *region, moved).map_err(|error| error.to_string())?;
        ticket.done((n + 1) as f64 / places.len() as f64);
        Ok((edge, moved))
    };
    places.iter().enumerate().take_while(|_| !ticket.is_cancelled()).map(edge).collect()
}
