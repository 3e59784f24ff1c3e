//! A recording composited on many machines, without a server: a plan of parts ([`FarmPlan`]) as
//! files for existing job engines ([`FarmJob`]), and the parts joined to one output ([`join`]).
//!
//! A frame depends on its inputs alone, so a range of frames that one machine composites equals the
//! same range of the whole. Each part has a record of its inputs and settings beside it
//! ([`crate::provenance::Record`]); parts with different records are rejected.

mod agreement;
mod command;
mod completeness;
mod cost;
mod error;
mod job_files;
mod join;
mod join_options;
mod join_video;
mod joined_record;
mod part_record;
mod ranges;
mod template;
mod template_text;

pub use agreement::check_agreement;
pub use command::PathParameter;
pub use completeness::{PartState, part_state};
pub use cost::PartCost;
pub use error::FarmError;
pub use join::{JoinSummary, join};
pub use join_options::{FrameTimes, JoinOptions};
pub use part_record::{RecordedPart, file_sha256, parts_at};
pub use ranges::{FarmPlan, MAX_PARTS, part_name};
pub use template::{ADAPTER_KINDS, FarmJob};
