//! Figures with plots.

use super::chart::{Chart, ChartShape, Ink, XAxis};
use super::correction::{Correction, corrections, usual_depth_m};
use super::page::{Body, Figure};
use super::slide::{LATER, SlidePair, slides, worse};
use super::{ReportError, ReportSource};
use crate::analyse::{EDGE_BIN_PX, HeldOutResidual, ToneBand};
use crate::fit::quantile::{upper_median, upper_quantile};
use crate::text::{count, fixed, short};

/// Heights of plots and of a labelled axis, units of a drawing that is 1840 wide.
const TALL: u32 = 480;
const LOW: u32 = 300;
const AXIS: u32 = 64;
/// Assumed depth for recordings without depth, m.
const ASSUMED_DEPTH_M: f64 = 2.0;

const RECORDED: (Ink, &str) = (Ink::Recorded, "as recorded");

pub fn correction(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Corrections of the recorded poses";
    let registered = &source.analysis.findings.registration;
    if source.analysis.refined().is_none() {
        let why = if registered.is_right() {
            "the recorded poses are right, and are kept bit for bit".to_owned()
        } else {
            format!("poses are as recorded: {}", registered.why.as_deref().unwrap_or("no reason was recorded"))
        };
        return Ok(Figure::left_out(title, why));
    }
    let depth_m = usual_depth_m(source)?.unwrap_or(ASSUMED_DEPTH_M);
    let all = corrections(source, depth_m);
    let of =
        |value: &dyn Fn(&Correction) -> f64| ChartShape::Line(all.iter().map(|c| (c.frame as f64, value(c))).collect());
    let axes = |vector: fn(&Correction) -> glam::DVec3| {
        let inks = [Ink::Red, Ink::Green, Ink::Blue];
        inks.iter().enumerate().map(|(k, ink)| (*ink, of(&move |c| vector(c)[k]))).collect::<Vec<_>>()
    };
    let plot = |y: &str, shapes, is_last: bool| Chart {
        x_axis: XAxis::Frames(source.recording.frame_count()),
        y: y.to_owned(),
        labels_x_axis: is_last,
        is_logarithmic: false,
        from_zero: is_last,
        height: if is_last { LOW + AXIS } else { LOW },
        shapes,
    };
    let plots = [
        plot("turn, °", axes(|c| c.turn_deg), false),
        plot("way, mm", axes(|c| c.way_mm), false),
        plot("picture, px", vec![(Ink::Found, of(&|c| c.picture_px))], true),
    ];
    Ok(Figure {
        title,
        caption: format!(
            "How the refined camera is turned and placed against the recorded one, in its own axes, and how far apart \
             both show things {} m away, mean over the picture. The constant part is the mounting of the camera on the \
             tracked body; the varying part made evidence slide.",
            fixed(depth_m, 1)
        ),
        legend: vec![(Ink::Red, "right"), (Ink::Green, "down"), (Ink::Blue, "forward"), (Ink::Found, "on the picture")],
        body: Body::Plots { plots: plots.iter().map(Chart::svg).collect::<Result<_, _>>()? },
    })
}

pub fn links(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Held-out frame pairs";
    let registered = &source.analysis.findings.registration;
    let missed = &source.analysis.held_out;
    if missed.is_empty() {
        let why = registered.why.as_deref().unwrap_or("none could be aligned");
        return Ok(Figure::left_out(title, format!("no frames were linked to judge the poses by: {why}")));
    }
    let residual_dots = |px: fn(&HeldOutResidual) -> f64| {
        ChartShape::Dots(missed.iter().map(|m| (0.5 * (m.from + m.to) as f64, px(m).max(0.01))).collect())
    };
    let share = |px: fn(&HeldOutResidual) -> f64, share: f64| {
        let mut all: Vec<f64> = missed.iter().map(px).collect();
        fixed(upper_quantile(&mut all, share).unwrap_or(0.0), 2)
    };
    let median_and_p90 = |px: fn(&HeldOutResidual) -> f64| format!("{} px, {} px", share(px, 0.5), share(px, 0.9));
    let chart = Chart {
        x_axis: XAxis::Frames(source.recording.frame_count()),
        y: "missed by, px".to_owned(),
        labels_x_axis: true,
        is_logarithmic: true,
        from_zero: false,
        height: TALL,
        shapes: vec![(Ink::Recorded, residual_dots(|m| m.recorded_px)), (Ink::Found, residual_dots(|m| m.refined_px))],
    };
    Ok(Figure {
        title,
        caption: format!(
            "{} of frames 3 and 7 apart, aligned by brightness and held out of the fit: by how much poses miss each \
             alignment. Errors common to all alignments are not included: see the slides in the picture below. Median \
             and 90 % as recorded: {}; {}: {}.",
            count(missed.len(), "pair"),
            median_and_p90(|m| m.recorded_px),
            if registered.is_refined() { "refined" } else { "if they were refined" },
            median_and_p90(|m| m.refined_px)
        ),
        legend: vec![RECORDED, (Ink::Found, "refined")],
        body: Body::Plots { plots: vec![chart.svg()?] },
    })
}

pub fn slide(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "What slides";
    let slid = match slides(source)? {
        Ok(slid) => slid,
        Err(why) => return Ok(Figure::left_out(title, why.to_owned())),
    };
    let is_refined = slid.iter().any(|pair| pair.refined_px.is_some());
    let slide_dots = |px: &dyn Fn(&SlidePair) -> Option<f64>, by: f64| {
        let at = |pair: &SlidePair| Some((pair.later as f64 + by, px(pair)?.max(0.01)));
        ChartShape::Dots(slid.iter().filter_map(at).collect())
    };
    let mut shapes = vec![(Ink::Recorded, slide_dots(&SlidePair::recorded_median_px, -0.4))];
    let mut legend = vec![RECORDED];
    if is_refined {
        shapes.push((Ink::Found, slide_dots(&SlidePair::refined_median_px, 0.4)));
        legend.push((Ink::Found, "refined"));
    }
    let chart = Chart {
        x_axis: XAxis::Values("frames later", 0.0..45.0),
        y: "slid by, px".to_owned(),
        labels_x_axis: true,
        is_logarithmic: true,
        from_zero: false,
        height: TALL,
        shapes,
    };
    let whole = |px: &dyn Fn(&SlidePair) -> Vec<f64>| {
        let median_text = |later: usize| {
            upper_median(slid.iter().filter(|pair| pair.later == later).flat_map(px))
                .map_or("–".to_owned(), |px| fixed(px, 2))
        };
        LATER.map(median_text).join(", ")
    };
    let mut caption = format!(
        "A frame's picture on its own depth, as poses put it into later frames, against what these show: each dot is a pair, the \
         median of its patches. Over all, {} frames later: {} px as recorded",
        LATER.map(|later| later.to_string()).join(", "),
        whole(&|pair| pair.recorded_px.clone())
    );
    if let Some((got_worse, slide_dots, largest_px)) = worse(&slid) {
        let refined = whole(&|pair| pair.refined_px.clone().unwrap_or_default());
        caption += &format!(
            ", {refined} px refined. Of {} {got_worse} got worse by more than 0.1 px",
            count(slide_dots, "pair")
        );
        caption += &if got_worse > 0 { format!(", by {} px at most", fixed(largest_px, 2)) } else { String::new() };
    }
    Ok(Figure { title, caption: caption + ".", legend, body: Body::Plots { plots: vec![chart.svg()?] } })
}

pub fn sharpness(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Sharpness of edges";
    let spread = source.analysis.findings.spread.as_ref();
    let Some((sigma_px, spread)) = spread.and_then(|spread| Some((spread.sigma_px?, spread))) else {
        let why = spread.and_then(|spread| spread.why.as_deref()).unwrap_or("it was not estimated");
        return Ok(Figure::left_out(title, why.to_owned()));
    };
    let bar = |(n, edges): (usize, &u32)| (n as f64 * EDGE_BIN_PX, (n + 1) as f64 * EDGE_BIN_PX, f64::from(*edges));
    let (own, others): (Vec<_>, Vec<_>) =
        (spread.edges_by_px.iter().enumerate().map(bar)).partition(|(from, to, _)| (*from..*to).contains(&sigma_px));
    let chart = Chart {
        x_axis: XAxis::Values("σ, px", 0.0..EDGE_BIN_PX * spread.edges_by_px.len().max(1) as f64),
        y: "edges".to_owned(),
        labels_x_axis: true,
        is_logarithmic: false,
        from_zero: true,
        height: LOW + AXIS,
        shapes: vec![(Ink::Recorded, ChartShape::Bars(others)), (Ink::Found, ChartShape::Bars(own))],
    };
    Ok(Figure {
        title,
        caption: format!(
            "Straight edges that stand alone, by the Gaussian that blurred each. Round or defocused edges are softer \
             than the camera's blur and none are sharper, so the 30th percentile is used: {} px. The last bar includes \
             wider ones.",
            fixed(sigma_px, 2)
        ),
        legend: vec![(Ink::Found, "the camera's")],
        body: Body::Plots { plots: vec![chart.svg()?] },
    })
}

pub fn tone(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Response of codes to light";
    let Some(tone) = source.analysis.findings.tone.as_ref().filter(|tone| !tone.bands.is_empty()) else {
        let why = source.analysis.findings.tone.as_ref().and_then(|tone| tone.why.as_deref());
        return Ok(Figure::left_out(title, why.unwrap_or("it was not estimated").to_owned()));
    };
    let level = |band: &ToneBand| {
        let (from, to) = (band.from.into(), band.to.into());
        (Ink::Found, ChartShape::Level { from, to, value: band.slope, sigma: band.sigma })
    };
    let right = (Ink::Recorded, ChartShape::Level { from: 0.0, to: 255.0, value: 1.0, sigma: 0.0 });
    let chart = Chart {
        x_axis: XAxis::Values("code", 0.0..255.0),
        y: "by middle codes".to_owned(),
        labels_x_axis: true,
        is_logarithmic: false,
        from_zero: false,
        height: LOW + AXIS,
        shapes: std::iter::once(right).chain(tone.bands.iter().map(level)).collect(),
    };
    Ok(Figure {
        title,
        caption: "When the light changes, the camera's response must give the same change for surfaces of all codes, \
                  with ± 1 σ. A common exponent is not observable. This is only advice."
            .to_owned(),
        legend: vec![(Ink::Found, "from code values"), (Ink::Recorded, "by the right response")],
        body: Body::Plots { plots: vec![chart.svg()?] },
    })
}

pub fn gain(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Brightness of the frames";
    let gains = &source.analysis.gains;
    if gains.is_empty() {
        let why = match &source.analysis.findings.gain {
            Some(gain) => format!("frames are equally bright, {gain}"),
            None => source.analysis.findings.no_gain().to_owned(),
        };
        return Ok(Figure::left_out(title, why));
    }
    let gain_line =
        |c: usize| ChartShape::Line(gains.iter().enumerate().map(|(n, g)| (n as f64, g[c].log2())).collect());
    let chart = Chart {
        x_axis: XAxis::Frames(gains.len()),
        y: "stops".to_owned(),
        labels_x_axis: true,
        is_logarithmic: false,
        from_zero: false,
        height: TALL,
        shapes: vec![(Ink::Red, gain_line(0)), (Ink::Green, gain_line(1)), (Ink::Blue, gain_line(2))],
    };
    Ok(Figure {
        title,
        caption: "Light of the same surfaces against the recording's median, by colour: exposure and gain move the \
                  three lines together, white balance moves them apart. Virtual objects follow them."
            .to_owned(),
        legend: vec![(Ink::Red, "red"), (Ink::Green, "green"), (Ink::Blue, "blue")],
        body: Body::Plots { plots: vec![chart.svg()?] },
    })
}

pub fn exposure(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Exposure time of the frames";
    let Some(shutter) = source.analysis.findings.shutter.as_ref().filter(|shutter| !shutter.runs.is_empty()) else {
        let why = source.analysis.findings.shutter.as_ref().and_then(|shutter| shutter.why.as_deref());
        return Ok(Figure::left_out(title, why.unwrap_or("no reason was recorded").to_owned()));
    };
    let recorded_ms =
        source.recording.exposure.iter().enumerate().filter_map(|(n, e)| Some((n as f64, 1e3 * e.time_s?)));
    let recorded_ms: Vec<(f64, f64)> = recorded_ms.collect();
    let mut legend = vec![(Ink::Found, "by blur: single frames, and runs with ± 1 σ")];
    let mut shapes = Vec::new();
    if !recorded_ms.is_empty() {
        legend.push(RECORDED);
        shapes.push((Ink::Recorded, ChartShape::Line(recorded_ms)));
    }
    shapes.extend(shutter.runs.iter().map(|run| {
        let (from, to) = (run.from as f64, (run.to - 1) as f64);
        (Ink::Found, ChartShape::Level { from, to, value: 1e3 * run.exposure_s, sigma: 1e3 * run.sigma_s })
    }));
    let samples = shutter.samples.iter().map(|(frame, s)| (*frame as f64, 1e3 * s)).collect();
    shapes.push((Ink::Found, ChartShape::Dots(samples)));
    let chart = Chart {
        x_axis: XAxis::Frames(source.recording.frame_count()),
        y: "exposure, ms".to_owned(),
        labels_x_axis: true,
        is_logarithmic: false,
        from_zero: true,
        height: LOW + AXIS,
        shapes,
    };
    let interval_ms = short((1e4 * source.recording.frame_interval_s).round() / 10.0);
    let assumed = if source.recording.kind.has_times() { "" } else { " by the nominal clock" };
    Ok(Figure {
        title,
        caption: format!(
            "By motion blur against that of neighbouring frames; {interval_ms} ms lie between two frames{assumed}. One \
             exposure holds for all frames unless a run of them differs."
        ),
        legend,
        body: Body::Plots { plots: vec![chart.svg()?] },
    })
}

pub fn spatial_gain(source: &ReportSource<'_>) -> Result<Figure, ReportError> {
    let title = "Brightness across the picture";
    let parts = &source.analysis.across;
    if parts.is_empty() {
        let fitted = &source.analysis.findings.across;
        let why = fitted.map_or("frames are equally bright, or cannot be compared".to_owned(), |f| f.to_string());
        return Ok(Figure::left_out(title, why));
    }
    let of =
        |at: [f32; 2]| ChartShape::Line(parts.iter().enumerate().map(|(n, a)| (n as f64, a.at(at).into())).collect());
    let chart = Chart {
        x_axis: XAxis::Frames(parts.len()),
        y: "stops".to_owned(),
        labels_x_axis: true,
        is_logarithmic: false,
        from_zero: false,
        height: TALL,
        shapes: vec![
            (Ink::Recorded, of([0.5, 0.5])),
            (Ink::Red, of([0.5, 0.0])),
            (Ink::Green, of([0.0, 0.5])),
            (Ink::Blue, of([1.0, 0.5])),
            (Ink::Found, of([0.5, 1.0])),
        ],
    };
    Ok(Figure {
        title,
        caption: "Brightness of the same surfaces in parts of the picture, relative to the frame's gain: local tone \
                  mapping, vignetting, or another response. Virtual objects follow it."
            .to_owned(),
        legend: vec![
            (Ink::Recorded, "middle"),
            (Ink::Red, "above"),
            (Ink::Green, "left"),
            (Ink::Blue, "right"),
            (Ink::Found, "below"),
        ],
        body: Body::Plots { plots: vec![chart.svg()?] },
    })
}
