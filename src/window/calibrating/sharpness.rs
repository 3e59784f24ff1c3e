//! Sharpness from edges.

use eframe::egui::{RichText, Ui};

use super::super::analysis::{self, RejectedEdge, moved_px};
use super::super::background::Background;
use super::super::matching::{GOOD_EDGE, draw_edge, edge_signal, plot_rejected_edges, width_text};
use super::super::plots::{self, Axes, DataSource};
use super::super::progress;
use super::super::region_picker::{RegionPrompt, RegionPurpose};
use super::super::session::Session;
use super::super::task::TaskControl;
use super::super::tool::ToolStack;
use super::parts::{self, Decision, FrameRegion, ListAction, RegionVerdict};
use locard_engine::calibrate::sharpness::{self, PARAMETER, combine};
use locard_engine::measure::slanted::{MIN_EXTENT_PX, SlantedEdge};
use locard_engine::params::Value;
use locard_engine::pixels::Rect;
use locard_engine::shot::Shot;
use locard_engine::text::fixed;

/// Each edge with its motion during the exposure, px.
type Edges = Vec<Result<(SlantedEdge, [f64; 2]), RejectedEdge>>;

/// Inputs of a measurement: edges, signal, and the project's version, which covers the camera's
/// response and motion.
type MeasurementKey = (Vec<FrameRegion>, usize, u64);

/// State of the section.
#[derive(Debug, Default)]
pub struct SharpnessPanel {
    edges: Vec<FrameRegion>,
    verdicts: Vec<RegionVerdict>,
    /// Signal of the edges: 0 is luma, then the channels.
    of: usize,
    measured: Background<MeasurementKey, Edges>,
}

impl SharpnessPanel {
    pub fn marks(&self, frame: usize) -> impl Iterator<Item = (Rect, String)> {
        let all = parts::marks("edge", &self.edges, &self.verdicts);
        all.filter(move |(of, ..)| *of == frame).map(|(_, at, name)| (at, name))
    }

    /// Cancels a running measurement.
    pub fn cancel(&mut self) {
        self.measured.cancel();
    }

    /// Takes a newly picked edge.
    pub fn take_picked(&mut self, session: &Session, tools: &mut ToolStack) {
        if let Some(picked) = parts::answer(tools, RegionPurpose::Edge, session) {
            self.edges.push(picked);
            self.verdicts.push(RegionVerdict::Waits);
        }
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, tools: &mut ToolStack) {
        parts::aside(ui, "Pick straight edges between two uniform areas, in focus, best while the camera rests.");
        let prompt =
            RegionPrompt { purpose: RegionPurpose::Edge, hint: GOOD_EDGE, min_side_px: MIN_EXTENT_PX, repeats: true };
        tools.region_button(ui, "Pick edges", prompt);
        if self.edges.is_empty() {
            return;
        }
        ui.horizontal(|ui| plots::choose_luma_or_channel(ui, &mut self.of));
        if !session.player.playing {
            let (shot, edges, of) = (session.project.shot().clone(), self.edges.clone(), self.of);
            let key = (edges.clone(), of, session.project.version());
            self.measured.request(ui.ctx(), key, move |control| measure(&shot, &edges, of, control));
        }
        let key = self.measured.last_key().filter(|(edges, of, _)| (edges, *of) == (&self.edges, self.of));
        let edges = key.and_then(|_| self.measured.last().cloned()).unwrap_or_default();
        if !edges.is_empty() {
            self.verdicts = edges.iter().map(verdict).collect();
        }
        match parts::list(ui, "edge", &self.verdicts) {
            Some(ListAction::Show(n)) => session.player.seek(self.edges[n].frame),
            Some(ListAction::Drop(n)) => {
                self.edges.remove(n);
                self.verdicts.remove(n);
            }
            None => {}
        }
        progress::of(ui, "Sharpness", &self.measured);
        let called = |n: usize| format!("edge {}", n + 1);
        let out = edges.iter().enumerate().filter_map(|(n, edge)| Some((n, edge.as_ref().err()?)));
        let color = |n: usize| plots::palette_color(n, ui.visuals());
        let out: Vec<_> =
            out.map(|(n, RejectedEdge { profile: seen, .. })| (called(n), color(n), seen.clone())).collect();
        let good: Vec<_> = edges.iter().enumerate().filter_map(|(n, edge)| Some((n, edge.as_ref().ok()?))).collect();
        for (n, (edge, moved)) in &good {
            for note in sharpness::notes(edge, *moved) {
                parts::aside(ui, format!("{}: {note}", called(*n)));
            }
        }
        let good: Vec<_> = good.into_iter().map(|(n, (edge, _))| (n, edge.clone())).collect();
        self.result(ui, session, good);
        plot_rejected_edges(ui, out);
    }

    /// Shows the measured edges, with their numbers.
    fn result(&mut self, ui: &mut Ui, session: &mut Session, good: Vec<(usize, SlantedEdge)>) {
        let edges: Vec<_> = good.iter().map(|(_, edge)| edge.clone()).collect();
        let Some(all) = combine(&edges) else { return };
        // A single edge has the colour of the other plots.
        let color =
            |n: usize| if good.len() == 1 { DataSource::Real.color(ui) } else { plots::palette_color(n, ui.visuals()) };
        let good: Vec<_> = good.iter().map(|(n, edge)| (color(*n), format!("edge {}", n + 1), edge.clone())).collect();
        let names = good.iter().map(|(color, name, _)| (*color, name.clone())).collect::<Vec<_>>();
        let axes = Axes {
            name: "Measured edges",
            x: "distance, px",
            y: "% of the step",
            x_range: Some([-3.0, 3.0]),
            y_from: Some(0.0),
        };
        plots::show(ui, &axes, move |plot| {
            good.iter().for_each(|(color, name, edge)| draw_edge(plot, name, edge, *color));
        });
        plots::legend_of(ui, &names.iter().map(|(color, name)| (*color, name.as_str())).collect::<Vec<_>>());
        let (table, name) = PARAMETER;
        let measured = Value::Number((1e3 * all.sigma_px).round() / 1e3);
        let present = session.project.value(table, name);
        let of_present = present.as_ref().map_or(String::new(), ToString::to_string);
        ui.label(format!(
            "measured {} ± {} px, current {of_present} px",
            fixed(all.sigma_px, 3),
            fixed(all.uncertainty_px, 3)
        ));
        if all.between_px > 0.0 {
            let text = "The edges differ by more than chance: round, defocused or moving edges are softer. The \
                        sharpest are the most reliable.";
            ui.label(RichText::new(text).small().weak());
        }
        match parts::apply_or_discard(ui, "sharpness", present.as_ref() == Some(&measured)) {
            Some(Decision::Apply) => match session.project.set(table, name, &measured) {
                Ok(()) => {
                    session.project.close_step();
                    session.show_message("The measured sharpness is in use");
                }
                Err(error) => session.show_message(error.to_string()),
            },
            Some(Decision::Discard) => {
                self.edges.clear();
                self.verdicts.clear();
                self.measured.clear();
            }
            None => {}
        }
    }
}

fn verdict(edge: &Result<(SlantedEdge, [f64; 2]), RejectedEdge>) -> RegionVerdict {
    match edge {
        Ok((edge, _)) => RegionVerdict::Good(width_text(edge)),
        Err(rejected) => RegionVerdict::Bad(rejected.why.clone()),
    }
}

fn measure(shot: &Shot, edges: &[FrameRegion], of: usize, control: &TaskControl) -> Edges {
    let response = shot.camera().response;
    let edge = |(n, FrameRegion { frame, at }): (usize, &FrameRegion)| {
        let unread = |why: String| RejectedEdge { why, profile: Vec::new() };
        let frame = shot.read(*frame).map_err(|error| unread(error.to_string()))?;
        let moved = moved_px(shot, &frame, *at);
        let edge = analysis::edge(&frame.pixels, &response, *at, moved, edge_signal(of))?;
        control.set_progress((n + 1) as f64 / edges.len() as f64);
        Ok((edge, moved))
    };
    edges.iter().enumerate().take_while(|_| !control.is_cancelled()).map(edge).collect()
}
