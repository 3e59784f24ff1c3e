//! The tab Match: plots of noise, brightness, edges and blur of virtual objects against those of
//! the camera's picture. Only unfolded sections are computed, on background threads.

use std::sync::Arc;

use eframe::egui::{self, RichText, Ui};
use glam::DVec2;

use super::analysis::{AnalysisRequest, FrameAnalysis, HISTOGRAM_BINS, RejectedEdge, SharedCompositor, analyse};
use super::background::Background;
use super::brightness_plot;
use super::controls::unknown_exposure;
use super::gpu_times;
use super::noise_match::NoiseMatch;
use super::picture::{PictureOutput, plate};
use super::plots::{self, Axes, DataSource};
use super::pointer_probe::PointerProbe;
use super::progress;
use super::region_picker::{RegionPrompt, RegionPurpose};
use super::session::Session;
use super::task::TaskControl;
use super::theme::MIN_TEXT_PT;
use super::tool::ToolStack;
use locard_engine::calibrate::{NoisePoint, sharpness, sigma_over_profile};
use locard_engine::camera::NoiseProfile;
use locard_engine::measure::slanted::{MIN_EXTENT_PX, SlantedEdge};
use locard_engine::pixels::{Pixels, Rect};
use locard_engine::recording::Recording;
use locard_engine::text::fixed;

/// Mean 8-bit code values of a patch by frame.
type PatchMeans = Result<Vec<[f64; 3]>, String>;

/// The tab of plots.
#[derive(Debug)]
pub struct Matching {
    channel: usize,
    /// Signal of the histograms: 0 is luma, then the channels.
    of: usize,
    /// Picked edges of the camera's picture and of the composite.
    edges: [Option<Rect>; 2],
    /// Signal of the edges: 0 is luma, then the channels.
    edges_of: usize,
    patch: Option<Rect>,
    analysis: Background<(usize, u64, AnalysisRequest), FrameAnalysis>,
    compositor: SharedCompositor,
    brightness: Background<Rect, PatchMeans>,
    noise_match: NoiseMatch,
}

impl Default for Matching {
    fn default() -> Self {
        Self {
            channel: 1,
            of: 0,
            edges: [None; 2],
            edges_of: 0,
            patch: None,
            analysis: Background::default(),
            compositor: SharedCompositor::default(),
            brightness: Background::default(),
            noise_match: NoiseMatch::default(),
        }
    }
}

/// A collapsible section with a description of a good match.
fn section(ui: &mut Ui, title: &str, opened: bool, good: &str, body: impl FnOnce(&mut Ui)) -> bool {
    let shown = egui::CollapsingHeader::new(RichText::new(title).strong()).default_open(opened).show(ui, |ui| {
        ui.label(RichText::new(good).small().weak());
        body(ui);
    });
    shown.body_returned.is_some()
}

impl Matching {
    /// Marked regions of the picture.
    pub fn marks(&self) -> impl Iterator<Item = (Rect, &'static str)> {
        let [real, drawn] = self.edges;
        [(real, "edge"), (drawn, "virtual edge"), (self.patch, "patch")].into_iter().filter_map(|(r, n)| Some((r?, n)))
    }

    /// The plots. `picked`: noise points of regions that the user picked for calibration.
    pub fn show(
        &mut self,
        ui: &mut Ui,
        session: &mut Session,
        tools: &mut ToolStack,
        pointed: Option<DVec2>,
        picked: Option<&[Vec<NoisePoint>; 3]>,
    ) {
        self.take_picked(tools);
        let mut request = AnalysisRequest::default();
        ui.horizontal(|ui| {
            plots::choose_channel(ui, &mut self.channel);
            if session.player.playing && !session.is_live() {
                ui.weak("the plots wait while it plays");
            }
        });
        if session.is_live() {
            // The results belong to a frame that is no longer shown.
            self.analysis.clear();
            self.brightness.clear();
            self.noise_match.clear();
            ui.add(egui::Label::new(WAITS_FOR_FROZEN).wrap());
        }
        ui.separator();
        progress::failure(ui, "Plots", &self.analysis);
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            let good = "Good: the virtual dots follow the profile's curve, among the real ones.";
            request.noise = section(ui, "Noise", true, good, |ui| self.noise(ui, session, picked));
            let good = "Good: no detector separates virtual patches from real ones; areas are near 0.5, ratios near 1.";
            if !section(ui, "Noise beside the camera's", false, good, |ui| self.noise_match.show(ui, session)) {
                self.noise_match.cancel();
            }
            let good = "Good: the objects have no darker blacks and no brighter whites than the light explains.";
            request.histograms = section(ui, "Brightness", false, good, |ui| self.histograms(ui));
            let good = "Good: the curves rise alike, and their widths agree within the uncertainty.";
            if section(ui, "Edges", false, good, |ui| self.edges(ui, tools)) {
                request.edges = self.edges;
                request.edges_of = edge_signal(self.edges_of);
            }
            let good = "Good: the drawing is as long and as soft as the real edges near the pointer.";
            section(ui, "Blur at the pointer", true, good, |ui| blur(ui, session, pointed));
            let good = "Good: the curve is flat, or the objects' exposure follows it. Steps are automatic exposure.";
            if !section(ui, "Patch over time", false, good, |ui| self.patch(ui, session, tools)) {
                self.brightness.cancel();
            }
            let good = "Good: the curve follows the changes you see. Objects change with it if the effect Exposure is \
                        on and follows the footage.";
            section(ui, "Brightness over time", false, good, |ui| brightness_plot::show(ui, session));
            let good = "Good: no effect takes long without a change that you see.";
            section(ui, "Render time", false, good, |ui| {
                if session.viewer.gpu().timestamps {
                    session.request_times();
                    gpu_times::show(ui, session.times());
                } else {
                    ui.weak("This graphics device has no clock.");
                }
            });
        });
        self.analyse(ui, session, request);
    }

    /// Cancels running computations while the tab is hidden.
    pub fn cancel(&mut self) {
        self.analysis.cancel();
        self.brightness.cancel();
        self.noise_match.cancel();
    }

    fn take_picked(&mut self, tools: &mut ToolStack) {
        for (edge, purpose) in self.edges.iter_mut().zip([RegionPurpose::RealEdge, RegionPurpose::VirtualEdge]) {
            *edge = tools.take_region(purpose).or(*edge);
        }
        self.patch = tools.take_region(RegionPurpose::Patch).or(self.patch);
    }

    /// Starts the analysis of the displayed frame if its inputs changed.
    fn analyse(&mut self, ui: &Ui, session: &Session, request: AnalysisRequest) {
        let Some(frame) = session.frame().filter(|_| request.anything() && !session.player.playing) else {
            return self.analysis.cancel();
        };
        let shot = session.project.shot().clone();
        let frame = Arc::clone(frame);
        let gpu = session.viewer.gpu().clone();
        let compositor = self.compositor.clone();
        let key = (frame.index, session.project.version(), request.clone());
        self.analysis
            .request(ui.ctx(), key, move |control| analyse(&compositor, &gpu, &shot, &frame, &request, control));
    }

    fn noise(&self, ui: &mut Ui, session: &Session, picked: Option<&[Vec<NoisePoint>; 3]>) {
        let c = self.channel;
        let analysis = self.analysis.last();
        let profile = session.project.edit().rig.noise.clone();
        let part = |part: Option<&Result<[Vec<NoisePoint>; 3], String>>| match part {
            Some(Ok(points)) => points[c].clone(),
            _ => Vec::new(),
        };
        let real = part(analysis.and_then(|analysis| analysis.real.as_ref()));
        let drawn = part(analysis.and_then(|analysis| analysis.drawn.as_ref()));
        let [of_profile, of_real, of_virtual] =
            [DataSource::Profile, DataSource::Real, DataSource::Virtual].map(|of| of.color(ui));
        let axes = Axes {
            name: "Noise by intensity",
            x: "pixel value (8 bit)",
            y: "noise σ",
            x_range: Some([0.0, 255.0]),
            y_from: Some(0.0),
        };
        let over = |points: &[NoisePoint]| sigma_over_profile(points, profile.as_ref()?, c);
        let over = [("virtual", over(&drawn)), ("real", over(&real))];
        let curve = profile.as_ref().map(|profile| curve(profile, c));
        let rings = picked.map_or_else(Vec::new, |picked| picked[c].clone());
        let has_rings = !rings.is_empty();
        plots::show(ui, &axes, move |plot| {
            if let Some(curve) = curve {
                plot.line(plots::line("profile", curve, of_profile));
            }
            plots::noise(plot, "real", &real, of_real);
            plots::noise(plot, "virtual", &drawn, of_virtual);
            plots::noise_rings(plot, "picked", &rings, of_real);
        });
        let real = if has_rings { "real, in uniform areas; rings: picked" } else { "real, in uniform areas" };
        plots::legend(
            ui,
            &[(DataSource::Profile, "profile"), (DataSource::Real, real), (DataSource::Virtual, "virtual")],
        );
        let over: Vec<String> =
            over.into_iter().filter_map(|(of, times)| Some(format!("{of} {}", fixed(times?, 2)))).collect();
        if !over.is_empty() {
            ui.label(RichText::new(format!("Noise relative to profile: {}", over.join(", "))).small());
        }
        if profile.is_none() {
            ui.label("The profile has no noise: virtual objects are drawn without. The tab Calibrate measures it.");
        }
        let parts = analysis.map(|a| [&a.real, &a.drawn]).into_iter().flatten();
        for why in parts.filter_map(|part| part.as_ref()?.as_ref().err()) {
            ui.label(RichText::new(why).small().weak());
        }
        if analysis.is_some_and(|a| matches!(&a.real, Some(Err(_)))) {
            ui.label(RichText::new(NO_UNIFORM_AREA).small());
        }
        if analysis.is_some_and(|a| matches!(&a.drawn, Some(Ok(points)) if points[c].is_empty())) {
            ui.label(RichText::new("No evidence is large enough in this frame.").small().weak());
        }
    }

    fn histograms(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| plots::choose_luma_or_channel(ui, &mut self.of));
        let of = self.of;
        let (of_real, of_virtual) = (DataSource::Real.color(ui), DataSource::Virtual.color(ui));
        let histograms = self.analysis.last().and_then(|analysis| analysis.histograms.as_ref());
        let width = 256.0 / HISTOGRAM_BINS as f64;
        let curve = |shares: &[f64]| -> Vec<[f64; 2]> {
            shares.iter().enumerate().map(|(bin, share)| [(bin as f64 + 0.5) * width, 100.0 * share]).collect()
        };
        let [object, surroundings] = match histograms {
            Some(Ok([object, surroundings])) => [curve(&object[of]), curve(&surroundings[of])],
            _ => Default::default(),
        };
        let is_empty = object.is_empty();
        let axes = Axes {
            name: "Brightness of object and surroundings",
            x: if of == 0 { "luma (8 bit)" } else { "pixel value (8 bit)" },
            y: "% of pixels",
            x_range: Some([0.0, 255.0]),
            y_from: Some(0.0),
        };
        plots::show(ui, &axes, move |plot| {
            plot.line(plots::line("surroundings", surroundings, of_real));
            plot.line(plots::line("object", object, of_virtual));
        });
        plots::legend(ui, &[(DataSource::Real, "surroundings, 24 px"), (DataSource::Virtual, "objects")]);
        match histograms {
            Some(Err(why)) => _ = ui.label(RichText::new(why).small().weak()),
            Some(Ok(_)) if is_empty => _ = ui.label(RichText::new("No evidence is in this frame.").small().weak()),
            _ => {}
        }
    }

    fn edges(&mut self, ui: &mut Ui, tools: &mut ToolStack) {
        ui.horizontal(|ui| {
            let edge = |purpose, hint| RegionPrompt { purpose, hint, min_side_px: MIN_EXTENT_PX, repeats: false };
            let hint = GOOD_EDGE;
            tools.region_button(ui, "Pick a real edge", edge(RegionPurpose::RealEdge, hint));
            let hint = "Drag a rectangle that one straight edge of evidence crosses from side to side, between two uniform areas";
            tools.region_button(ui, "Pick a virtual edge", edge(RegionPurpose::VirtualEdge, hint));
        });
        if self.edges != [None; 2] {
            ui.horizontal(|ui| plots::choose_luma_or_channel(ui, &mut self.edges_of));
        }
        let edges = self.analysis.last().map(|analysis| analysis.edges.clone()).unwrap_or_default();
        let colors = [DataSource::Real, DataSource::Virtual].map(|of| of.color(ui));
        let axes = Axes {
            name: "Edges",
            x: "distance, px",
            y: "% of the step",
            x_range: Some([-3.0, 3.0]),
            y_from: Some(0.0),
        };
        let both = edges.clone();
        if both.iter().flatten().flatten().next().is_some() {
            plots::show(ui, &axes, move |plot| {
                for ((edges, color), name) in both.iter().zip(colors).zip(["real", "virtual"]) {
                    if let Some(Ok(edge)) = edges {
                        draw_edge(plot, name, edge, color);
                    }
                }
            });
        }
        let mut out = Vec::new();
        for (edges, (of, name)) in edges.iter().zip([(DataSource::Real, "real"), (DataSource::Virtual, "virtual")]) {
            match edges {
                Some(Ok(edge)) => plots::legend(ui, &[(of, &format!("{name}: {}", width_text(edge)))]),
                Some(Err(RejectedEdge { why, profile: seen })) => {
                    ui.label(RichText::new(format!("{name}: {why}")).small());
                    out.push((name.to_owned(), of.color(ui), seen.clone()));
                }
                None => {}
            }
        }
        plot_rejected_edges(ui, out);
    }

    fn patch(&mut self, ui: &mut Ui, session: &Session, tools: &mut ToolStack) {
        let hint = "Drag a rectangle: its mean brightness is followed through the frames";
        let prompt = RegionPrompt { purpose: RegionPurpose::Patch, hint, min_side_px: 1, repeats: false };
        tools.region_button(ui, "Pick a patch", prompt);
        let Some(patch) = self.patch.filter(|_| !session.is_live()) else { return };
        let recording = Arc::clone(&session.project.shot().recording);
        self.brightness.request(ui.ctx(), patch, move |control| means(&recording, patch, control));
        let c = self.channel;
        progress::of(ui, "Patch over time", &self.brightness);
        match self.brightness.last() {
            Some(Ok(series)) => {
                let points: Vec<[f64; 2]> = series.iter().enumerate().map(|(i, mean)| [i as f64, mean[c]]).collect();
                let here = series.get(session.player.frame()).map(|mean| [session.player.frame() as f64, mean[c]]);
                let (color, accent) = (DataSource::Real.color(ui), DataSource::Virtual.color(ui));
                let axes =
                    Axes { name: "Mean of a patch", x: "frame", y: "pixel value (8 bit)", x_range: None, y_from: None };
                plots::show(ui, &axes, move |plot| {
                    plot.line(plots::line("patch", points, color));
                    plot.points(plots::dots("this frame", here.into_iter().collect(), accent));
                });
                let ends = series.iter().map(|m| m[c]).fold((255.0, 0.0), |(l, h): (f64, f64), m| (l.min(m), h.max(m)));
                let now = here.map_or(String::new(), |[_, mean]| format!("now {}, ", fixed(mean, 1)));
                ui.label(RichText::new(format!("{now}{} to {} over time", fixed(ends.0, 1), fixed(ends.1, 1))).small());
            }
            Some(Err(why)) => _ = ui.label(RichText::new(why).small()),
            None => {}
        }
    }
}

/// Text of an edge width with its uncertainty.
pub fn width_text(edge: &SlantedEdge) -> String {
    let rise = edge.rise_10_90_px.map_or(String::new(), |rise| format!("; 10-90 % in {} px", fixed(rise, 2)));
    format!("σ {} ± {} px{rise}", fixed(edge.sigma_px, 3), fixed(edge.uncertainty_px, 3))
}

/// Notice instead of plots during a live view.
const WAITS_FOR_FROZEN: &str = "No plot is drawn for the live camera: its picture changes before it is measured. \
                                Freeze it (Space) to plot the frozen picture.";

/// Advice for a frame without uniform areas.
const NO_UNIFORM_AREA: &str = "This frame has too few uniform areas to estimate the camera's noise. Go to a frame with a \
                              wall, a table or paper in it, or pick uniform areas yourself: the tab Calibrate measures \
                              them, and their dots are shown here as rings.";

/// Instructions for picking an edge.
pub const GOOD_EDGE: &str = "Drag a rectangle that one straight edge crosses from side to side: uniform on both sides, about 20 px each, \
                             nothing else in it";

/// Signal of edges for an index of the buttons: 0 is luma, then the channels.
pub fn edge_signal(chosen: usize) -> sharpness::EdgeLight {
    chosen.checked_sub(1).map_or(sharpness::EdgeLight::Best, sharpness::EdgeLight::Channel)
}

/// A rejected edge: name, colour, and edge profile.
pub type RejectedEdgePlot = (String, egui::Color32, Vec<[f64; 2]>);

/// Profiles of rejected edges, dashed, in a plot of their own.
pub fn plot_rejected_edges(ui: &mut Ui, edges: Vec<RejectedEdgePlot>) {
    let edges: Vec<RejectedEdgePlot> = edges.into_iter().filter(|(.., seen)| !seen.is_empty()).collect();
    if edges.is_empty() {
        return;
    }
    let axes = Axes {
        name: "Refused edges",
        x: "distance from the middle, px",
        y: "% of full light",
        x_range: None,
        y_from: Some(0.0),
    };
    let names: Vec<_> = edges.iter().map(|(name, color, _)| (*color, format!("{name}: refused"))).collect();
    plots::show(ui, &axes, move |plot| {
        for (name, color, seen) in edges {
            let curve = seen.iter().map(|[d, light]| [*d, 100.0 * light]).collect();
            plot.line(plots::line(&name, curve, color).style(egui_plot::LineStyle::dashed_dense()));
        }
    });
    plots::legend_of(ui, &names.iter().map(|(color, name)| (*color, name.as_str())).collect::<Vec<_>>());
    ui.label(RichText::new("Only one step between two level parts can be measured.").small());
}

/// An edge spread function: samples as dots, the fit as a line.
pub fn draw_edge(plot: &mut egui_plot::PlotUi<'_>, name: &str, edge: &SlantedEdge, color: egui::Color32) {
    let share = |light: f64| 100.0 * (light - edge.dark) / (edge.bright - edge.dark);
    let near = |d: f64| d.abs() <= 8.0;
    let dots = edge.spread.iter().filter(|[d, _]| near(*d)).map(|[d, light]| [*d, share(*light)]).collect();
    let fit = edge.spread.iter().zip(&edge.fitted).filter(|([d, _], _)| near(*d));
    let fit = fit.map(|([d, _], light)| [*d, share(*light)]).collect();
    plot.line(plots::line(name, fit, color));
    plot.points(plots::dots(name, dots, color).radius(1.6));
}

/// σ of a channel by code value.
pub fn curve(profile: &NoiseProfile, channel: usize) -> Vec<[f64; 2]> {
    (0..=255).step_by(3).map(|code| [f64::from(code), profile.sigma(channel, f64::from(code))]).collect()
}

fn blur(ui: &mut Ui, session: &Session, pointed: Option<DVec2>) {
    let Some(at) = pointed else {
        ui.weak("Point at something in the picture.");
        return;
    };
    let Some(frame) = session.frame() else { return };
    match PointerProbe::at(session.project.shot(), frame, at) {
        Ok(pointed) => {
            pointed.show(ui);
            if let Some(note) = session.project.shot().unknown_exposure() {
                unknown_exposure(ui, &note);
            }
        }
        Err(why) => _ = ui.label(RichText::new(why).small()),
    }
}

/// Mean of a patch over all frames.
fn means(recording: &Recording, patch: Rect, control: &TaskControl) -> PatchMeans {
    let count = recording.frame_count();
    let mut series = Vec::with_capacity(count);
    for frame in recording.frames(0..count).map_err(|error| error.to_string())? {
        if control.is_cancelled() {
            break;
        }
        series.push(mean(&frame.map_err(|error| error.to_string())?.pixels, patch));
        control.set_progress(series.len() as f64 / count as f64);
    }
    Ok(series)
}

fn mean(pixels: &Pixels, patch: Rect) -> [f64; 3] {
    let patch = patch.intersection(&Rect::full(pixels.width, pixels.height));
    let mut sums = [0.0; 3];
    for (y, x) in (patch.y0..patch.y1).flat_map(|y| (patch.x0..patch.x1).map(move |x| (y, x))) {
        let codes = pixels.at(x as u32, y as u32);
        sums.iter_mut().zip(codes).for_each(|(sum, code)| *sum += f64::from(code));
    }
    let count = f64::from(patch.width()) * f64::from(patch.height()) * f64::from(pixels.max_code()) / 255.0;
    sums.map(|sum| sum / count.max(1.0))
}

/// Outlines regions in the picture, each with its name.
pub fn paint(picture: &PictureOutput, marks: impl Iterator<Item = (Rect, String)>) {
    for (rect, name) in marks {
        let at = |x: i32, y: i32| picture.placed.screen(egui::vec2(x as f32, y as f32));
        let on_screen = egui::Rect::from_min_max(at(rect.x0, rect.y0), at(rect.x1, rect.y1));
        let stroke = |width: f32, color| egui::Stroke::new(width, color);
        for stroke in [stroke(3.0, egui::Color32::from_black_alpha(120)), stroke(1.0, egui::Color32::WHITE)] {
            picture.painter.rect_stroke(on_screen, 0.0, stroke, egui::StrokeKind::Outside);
        }
        // Above the region, or inside the panel if the region extends beyond it.
        let top = (on_screen.top() - 6.0).max(picture.painter.clip_rect().top() + 20.0);
        plate(&picture.painter, egui::pos2(on_screen.left() + 6.0, top), egui::Align2::LEFT_BOTTOM, &name, MIN_TEXT_PT);
    }
}
