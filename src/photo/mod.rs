//! Photographs of the augmented site: the whole picture, real and virtual, as a virtual single-lens reflex takes it.
//!
//! framing → real part, exposed → virtual part drawn at the photograph's own size, composited, grain (tile by tile).
//!
//! - The camera stands where the recording's stood. A longer lens or a smaller film sees a part of the recorded picture;
//!   what the recording did not see cannot be photographed. Distortion stays the recording's.
//! - The real part is enlarged, and brightened by the stops by which the photograph is exposed more: on linear light.
//!   Where the shutter is open longer than a frame lasts, the recording's own frames are summed.
//! - The virtual part is drawn at the photograph's size through the virtual lens, and exposed alike before it can clip.
//! - Where the recording has depth, real and virtual things blur together: the real part's surfaces are made once, holes
//!   filled, edges put on the picture's, and what stands behind them made up (`depth/`).
//! - RealPart pixels carry noise already: what the recording's noise became on its way here is taken off the grain that the
//!   photograph's film has (shaders/composite.wgsl). They keep the recorded motion.
//!
//! Not modelled: depth of field on the real part of recordings without depth, shutters shorter than the recording's (the real part stays blurred),
//! highlights that the recording has clipped.

mod focus;
mod framing;
mod real;
mod sheet;
mod take;

pub use crate::camera::Summed;
pub use focus::distance_m;
pub use framing::{Aim, Framing, FramingError};
pub use real::{RealPart, shutter_weights};
pub use sheet::{contact_sheet, small};
pub use take::{Exposed, Standpoint, TakeError, Taken, take};

/// The effect that shows how things move while the shutter is open. Without it the frames of a hand-held recording are not
/// summed either: real and virtual things are as sharp as each other.
pub const OF_MOTION: &str = "motion_blur";
