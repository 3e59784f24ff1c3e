//! What a camera is called on the command line.

use std::path::Path;

/// The number of a camera, by its number or its device's path.
pub fn number(asked: &str) -> Option<usize> {
    let name = Path::new(asked).strip_prefix("/dev").ok().and_then(|name| name.to_str()?.strip_prefix("video"));
    name.unwrap_or(asked).parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_named_by_number_or_device() {
        assert_eq!(
            ["0", "/dev/video12", "video.mp4", "/dev/null", "x"].map(number),
            [Some(0), Some(12), None, None, None]
        );
    }
}
