//! Covariances of poses, as text beside their trajectory.

use crate::text::number;

/// Covariance of a pose: of a rotation about the camera's axes (x, y, z; rad), then of the world's
/// origin in them (x, y, z; m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covariance {
    /// Time of the pose.
    pub time_s: f64,
    /// The upper triangle, row by row.
    pub upper: [f64; 21],
}

const HEAD: &str = "# The covariance of each pose in poses.txt: its time (s), then 21 numbers, the upper triangle row by row.\n\
    # Of a turn about the camera's axes x, y, z (rad), then of the world's origin in these axes x, y, z (m).\n";

/// One line per pose with exact numbers, with or without the head of two lines.
pub fn write_covariances(covariances: &[Covariance], with_head: bool) -> String {
    let mut text = if with_head { HEAD.to_owned() } else { String::new() };
    for Covariance { time_s, upper } in covariances {
        text += &number(*time_s);
        upper.iter().for_each(|value| text += &format!(" {}", number(*value)));
        text += "\n";
    }
    text
}
