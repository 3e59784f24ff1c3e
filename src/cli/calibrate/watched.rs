//! Views for a calibration, taken from a camera by themselves.

use std::time::{Duration, Instant};

use anyhow::Result;

use crate::calibrate::board::{Search, Wanted};
use crate::calibrate::geometry::{LensOptions, Look, Taking};
use crate::camera::Response;
use crate::cli::progress_of;
use crate::cli::warn;
use crate::cli::watching::{Agreed, PicturesArgs};
use crate::live::Next;
use crate::words::{count, fixed};

/// Watches a camera until nothing is missing, or until somebody ends it.
pub fn taken(
    camera: &str,
    pictures: &PicturesArgs,
    wanted: usize,
    (board, response): (&Wanted, &Response),
    options: LensOptions,
) -> Result<Taking> {
    let mut search = Search::new(board, response)?;
    let agreed = Agreed::without_poses(camera, pictures)?;
    let delivered = agreed.opened.camera.given.delivered;
    let mut taking = Taking::new((delivered.width, delivered.height), wanted, options);
    let line = progress_of(pictures.quiet, 0, "{wide_msg}");
    let mut watching = agreed.start()?;
    let mut frames = 0;
    while !taking.missing().is_empty() && watching.goes_on(frames) {
        match watching.next(Instant::now() + Duration::from_millis(50)) {
            Next::Picture(came) => {
                let (picture, pixels) = *came;
                let name = format!("frame {frames}");
                let look = taking.look(picture.time_s, &name, search.find(&pixels).ok());
                frames += 1;
                line.set_message(told(&taking, look));
                // A pipe gets a line for each view.
                if look == Look::Taken && line.is_hidden() {
                    warn(pictures.quiet, &told(&taking, look));
                }
            }
            Next::Nothing => {}
            Next::Ended => break,
        }
    }
    line.finish_and_clear();
    watching.close(&format!("{} of ", count(taking.views().len(), "view")), frames, 0);
    Ok(taking)
}

/// How far it is, and what to do: in 80 columns.
fn told(taking: &Taking, look: Look) -> String {
    let (views, share) = (taking.views().len(), fixed(100.0 * taking.coverage().share(), 0));
    let next = taking.hint().unwrap_or("nothing is missing".to_owned());
    let now = match look {
        Look::NoBoard => "no board; ",
        Look::Moving => "moving; ",
        Look::Taken => "taken; ",
        Look::Known => "",
    };
    format!("{views} of {} views, {share} % seen; {now}{next}", taking.wanted())
}
