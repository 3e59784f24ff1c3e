//! Photographs of the augmented site: the whole picture, real and virtual, as taken by a virtual
//! single-lens reflex.
//!
//! Request ([`PhotoRequest::take`]) → framing → real part → virtual part drawn at the photograph's
//! own size, composited and exposed, grain (tile by tile).
//!
//! - The camera is at the recording's position. A longer lens or a smaller film crops the recorded
//!   picture; nothing beyond it can be photographed. The distortion is the recording's.
//! - The real part is enlarged, and brightened in linear light by the difference in exposure. If
//!   the shutter is open longer than a frame lasts, the recording's own frames are summed.
//! - The virtual part is drawn at the photograph's size through the virtual lens, and exposed in
//!   the same way before clipping.
//! - If the recording has depth, real and virtual objects are blurred together. The real part's
//!   surfaces are computed once, with holes filled, edges aligned to the picture's, and the
//!   background inpainted (`depth/`).
//! - Real pixels are already noisy: the remaining noise of the recording is subtracted from the
//!   grain of the photograph's film (shaders/composite.wgsl). They keep the recorded motion blur.
//!
//! Not modelled: depth of field on the real part of recordings without depth, shutters shorter than
//! the recording's (the real part stays blurred), highlights that the recording has clipped.

mod card;
mod coverage;
mod error;
mod exposure_controls;
mod focus;
mod framing;
pub mod log;
mod occlusion;
mod particulars;
mod plan;
mod plane_view;
mod real;
mod record;
mod request;
mod series;
mod sheet;
mod shoot;
mod shoot_particulars;
mod take;
mod target;
mod view;

pub use crate::camera::SummedExposure;
pub use card::CaseCard;
pub use error::PhotoError;
pub use focus::distance_m;
pub use framing::{Aim, Framing, FramingError};
pub use occlusion::SummedFrameOcclusion;
pub use particulars::{CameraSupport, ObjectInView, Particulars, PhotoContent, ScaleInView, Subject, ViewParticulars};
pub use plane_view::{foreshortening, height_error, mm_per_px, tilt_error};
pub use real::{RealPart, shutter_weights};
pub use record::{next_number, read_particulars, read_record, record_path, write_record};
pub use request::{Bracket, Focus, PhotoRequest, existing_series};
pub use series::{PhotoEvent, RetakenPhoto};
pub use sheet::{contact_sheet, thumbnail};
pub use take::{PhotoExposure, Photograph, Standpoint, TakeError, take};

/// The motion blur effect. Without it the frames of a hand-held recording are not summed either, so
/// that real and virtual objects are equally sharp.
pub const MOTION_EFFECT: &str = "motion_blur";
