//! Live compositing: frames are composited as they arrive, and recorded so that the recording
//! reproduces the same images.
//!
//! - [`FrameQueue`] decides when a frame has its poses. It does no I/O; the time is an argument.
//! - [`Intake`] records each frame and emits it exactly as a reader of the recording gets it.
//! - [`LiveCompositor`] composites the frames.
//! - [`Feed`] runs the capture on a thread, for callers that composite themselves.
//! - [`PoseSource`] supplies the camera poses.

mod board_check;
mod capture;
mod delay_search;
mod delayed;
mod error;
mod feed;
mod frame_queue;
mod intake;
mod lens_track;
mod live_compositor;
mod motion_predictor;
mod opacity_fade;
mod open;
mod options;
mod picture_file;
mod pose_source;
mod recorded_poses;
mod recorder_thread;
mod replay_buffer;
mod stream_poses;
mod tag_poses;
mod track;

pub use capture::{CaptureEvent, LiveCapture};
pub use delay_search::{DelayError, DelaySearch};
pub use delayed::{DelayMode, delayed};
pub use error::LiveError;
pub use feed::{Feed, FeedStatus, TrackedFrame};
pub use frame_queue::{FrameQueue, LiveCounts, ReleasedFrame};
pub use intake::{Intake, LiveFrame, PictureOutcome};
pub use lens_track::LensTrack;
pub use live_compositor::{InFlightFrame, LiveComposite, LiveCompositor};
pub use open::{LiveInput, StreamLens, camera_of_profile, open, open_poses};
pub use options::{LiveOptions, LiveSpec};
pub use picture_file::{PictureFile, picture_file};
pub use pose_source::PoseSource;
pub use recorded_poses::RecordedPoses;
pub use recorder_thread::RecorderThread;
pub use replay_buffer::ReplayBuffer;
pub use track::{LiveTrack, PoseOutcome, Tracking};
