//! GPU time by effect.

use std::collections::VecDeque;

use eframe::egui::{self, RichText, Ui};

use super::plots::DataSource;
use locard_engine::fit::quantile::upper_median;
use locard_engine::gpu::PartTime;
use locard_engine::text::fixed;

/// Number of pictures for the medians.
const MEDIAN_PICTURES: usize = 15;

/// Times of the last pictures.
#[derive(Debug, Default)]
pub struct GpuTimes {
    /// Reduction factor of the pictures' size.
    reduced_by: u32,
    pictures: VecDeque<Vec<PartTime>>,
}

impl GpuTimes {
    pub fn add(&mut self, reduced_by: u32, times: Vec<PartTime>) {
        if reduced_by != self.reduced_by {
            (self.reduced_by, self.pictures) = (reduced_by, VecDeque::new());
        }
        if !times.is_empty() {
            self.pictures.push_back(times);
        }
        while self.pictures.len() > MEDIAN_PICTURES {
            self.pictures.pop_front();
        }
    }

    /// Parts of the last picture, in order, with the median of their times.
    pub fn medians(&self) -> Vec<PartTime> {
        let Some(last) = self.pictures.back() else { return Vec::new() };
        let median = |part: &PartTime| {
            let same = |times: &Vec<PartTime>| times.iter().find(|of| of.part == part.part).map(|of| of.time_s);
            let median_s = upper_median(self.pictures.iter().filter_map(same));
            PartTime { time_s: median_s.unwrap_or(part.time_s), ..*part }
        };
        last.iter().map(median).collect()
    }
}

/// A bar for each part.
pub fn show(ui: &mut Ui, times: &GpuTimes) {
    let times = times.medians();
    if times.is_empty() {
        ui.weak("Comes with the next picture: play, or move a slider.");
        return;
    }
    let all_s: f64 = times.iter().map(|of| of.time_s).sum();
    let longest_s = times.iter().map(|of| of.time_s).fold(1e-9, f64::max);
    let color = DataSource::Virtual.color(ui).gamma_multiply(0.7);
    egui::Grid::new("times").num_columns(3).spacing([8.0, 3.0]).show(ui, |ui| {
        for PartTime { part, time_s } in &times {
            ui.label(RichText::new(label(part)).small());
            let (rect, response) = ui.allocate_exact_size(egui::vec2(150.0, 12.0), egui::Sense::hover());
            let width = rect.width() * (time_s / longest_s) as f32;
            let bar = egui::Rect::from_min_size(rect.min, egui::vec2(width.max(1.0), rect.height()));
            ui.painter().rect_filled(bar, 1.0, color);
            let text = format!("{} ms", fixed(1e3 * time_s, 2));
            response.widget_info(|| {
                egui::WidgetInfo::labeled(egui::Role::ProgressIndicator, true, format!("{}: {text}", label(part)))
            });
            ui.monospace(RichText::new(text).small());
            ui.end_row();
        }
    });
    let gpu = RichText::new(format!("{} ms on the GPU in all; medians of the last pictures", fixed(1e3 * all_s, 1)))
        .small()
        .weak();
    ui.label(gpu).on_hover_text(
        "Noise and edges act while objects are mixed into the picture, in one pass. A software driver \
         shares its processors with the rest of the machine.",
    );
}

fn label(part: &str) -> String {
    match part {
        "depth" => "occlusion".to_owned(),
        "shadow" => "shadows".to_owned(),
        "objects" => "drawing objects".to_owned(),
        "mix" => "mixing, noise, edges".to_owned(),
        effect => effect.replace('_', " "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_suppress_a_single_slow_picture() {
        let mut times = GpuTimes::default();
        for time_s in [1.0, 1.0, 9.0, 2.0, 1.5] {
            times.add(1, vec![PartTime { part: "objects", time_s }, PartTime { part: "mix", time_s: 0.5 }]);
        }
        let medians = times.medians();
        assert_eq!(medians, [PartTime { part: "objects", time_s: 1.5 }, PartTime { part: "mix", time_s: 0.5 }]);
        // Another size starts over, and a removed effect is not shown.
        times.add(2, vec![PartTime { part: "mix", time_s: 0.25 }]);
        assert_eq!(times.medians(), [PartTime { part: "mix", time_s: 0.25 }]);
        (0..40).for_each(|_| times.add(2, vec![PartTime { part: "mix", time_s: 0.75 }]));
        assert_eq!(times.pictures.len(), MEDIAN_PICTURES);
    }
}
