//! Provenance records: a JSON file beside an output with everything that it takes to make the
//! output again, and the digests of the files that were read and of the pictures that were written.
//!
//! The record of `out` is `out.record.json`, that of `clip.mp4` is `clip.mp4.record.json`. Digests
//! are SHA-256 in hexadecimal, as `sha256sum` prints them. A picture's digest is that of its code
//! values as they are stored: R, G, B, row by row, 16-bit codes in little-endian order. It does not
//! depend on a picture format; `ffmpeg -i FRAME -f rawvideo -pix_fmt rgb24 - | sha256sum` gives the
//! same. Of a photograph it is that of its decoded file.
//!
//! A record is not signed: it is evidence only as far as its source is trusted.

pub mod audit;
mod digests;
mod inputs;
mod mask;
mod pictures;
mod record;
mod signature;
mod work;

pub use digests::{DigestedFile, bytes_digest, file_digest, pixels_digest};
pub use inputs::{DigestedInputs, InputDigests, input_files};
pub use mask::{FrameMask, MaskRecord, RunLengths};
pub use pictures::{PictureDifference, StoredPictureError, difference, read_picture};
pub use record::{
    OutputKind, OutputRecord, PictureLines, PictureRecord, ProvenanceError, RECORD_ENDING, RECORD_VERSION, Record,
    as_read, output_of_record, record_path, remove_record,
};
pub use signature::{has_signature, sidecar_path};
pub use work::{CommandRecord, DeviceRecord, InputRecord, ProgramRecord, SettingsRecord, WorkRecord, video_programs};
