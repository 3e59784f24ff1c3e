//! What an analysis found, as a page that a browser opens: one file of HTML with its pictures and plots within, without script.
//!
//! It reads an [`Analysis`](crate::analyse::Analysis) and the recording that it is of, as it was recorded, and knows nothing of
//! who asks. What the recording cannot show is left out, and the page says why.

mod chart;
mod correction;
mod edges;
mod estimates;
mod followed;
mod page;
mod panorama;
mod places;
mod plots;
mod sight;
mod slide;
mod source;
mod strips;
mod tile;

pub use slide::{LATER, Slid, median_px, slides, worse};
pub use source::{MADE_BY, ReportError, Source};

/// The page. The same analysis and recording give the same bytes, but for [`Source::times`].
pub fn html(source: &Source<'_>) -> Result<String, ReportError> {
    let mut figures = vec![plots::correction(source)?, plots::links(source)?, plots::slide(source)?];
    figures.extend([edges::edges(source)?, strips::point(source)?, plots::gain(source)?, plots::across(source)?]);
    figures.extend([
        strips::brightness(source)?,
        plots::exposure(source)?,
        plots::sharpness(source)?,
        plots::tone(source)?,
        panorama::panorama(source)?,
    ]);
    page::page(source, figures)
}
