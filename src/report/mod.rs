//! HTML report of an analysis: a single file with embedded pictures and plots, without scripts.
//!
//! Its inputs are an [`Analysis`](crate::analyse::Analysis) and the recording as it was recorded.
//! Figures that the recording cannot provide are replaced by the reason.

mod chart;
mod correction;
mod edges;
mod estimates;
mod page;
mod panorama;
mod places;
mod plots;
mod point_track;
mod rolling_camera;
mod slide;
mod source;
mod strips;
mod tile;

pub use slide::{LATER, SlidePair, slides, worse};
pub use source::{MADE_BY, ReportError, ReportSource};

/// The page. The same analysis and recording give the same bytes, but for [`ReportSource::times`].
pub fn html(source: &ReportSource<'_>) -> Result<String, ReportError> {
    let mut figures = vec![plots::correction(source)?, plots::links(source)?, plots::slide(source)?];
    figures.extend([edges::edges(source)?, strips::point(source)?, plots::gain(source)?, plots::spatial_gain(source)?]);
    figures.extend([
        strips::brightness(source)?,
        plots::exposure(source)?,
        plots::sharpness(source)?,
        plots::tone(source)?,
        panorama::panorama(source)?,
    ]);
    page::page(source, figures)
}
