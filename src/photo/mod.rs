//! Photographs of the augmented site: the whole picture, real and virtual, as taken by a virtual single-lens reflex.
//!
//! what is wanted ([`Wanted::take`]) → framing → real part → virtual part drawn at the photograph's own size, composited
//! and exposed, grain (tile by tile).
//!
//! - The camera is where the recording's was. A longer lens or a smaller film sees a part of the recorded picture; what
//!   was not recorded cannot be photographed. The distortion is the recording's.
//! - The real part is enlarged, and brightened by the stops by which the photograph is exposed more, in linear light.
//!   If the shutter is open longer than a frame lasts, the recording's own frames are summed.
//! - The virtual part is drawn at the photograph's size through the virtual lens, and exposed alike before it can clip.
//! - If the recording has depth, real and virtual things are blurred together. The real part's surfaces are made once,
//!   with holes filled, edges moved to the picture's, and what is behind them synthesised (`depth/`).
//! - Real pixels are noisy already: what remains of the recording's noise is subtracted from the grain of the
//!   photograph's film (shaders/composite.wgsl). They keep the recorded motion blur.
//!
//! Not modelled: depth of field on the real part of recordings without depth, shutters shorter than the recording's
//! (the real part stays blurred), highlights that the recording has clipped.

mod dials;
mod error;
mod focus;
mod framing;
mod hiding;
mod real;
mod series;
mod sheet;
mod shoot;
mod take;
mod target;
mod wanted;

pub use crate::camera::Summed;
pub use error::PhotoError;
pub use focus::distance_m;
pub use framing::{Aim, Framing, FramingError};
pub use hiding::Hiding;
pub use real::{RealPart, shutter_weights};
pub use series::Told;
pub use sheet::{contact_sheet, small};
pub use take::{Exposed, Standpoint, TakeError, Taken, take};
pub use wanted::{Bracket, Focus, Wanted, series_there};

/// The effect that shows motion while the shutter is open. Without it the frames of a hand-held recording are not
/// summed either, so that real and virtual things are equally sharp.
pub const OF_MOTION: &str = "motion_blur";
