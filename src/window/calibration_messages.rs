//! Messages about calibration for the window, which has no command-line options and in which each
//! picked place is a scene.

use locard_engine::calibrate::{CalibrateError, PickedError, Warning};
use locard_engine::text::{count, fixed, without_options};

/// Why the noise could not be measured.
pub fn noise_error(error: &CalibrateError) -> String {
    use CalibrateError as E;
    match error {
        E::NoFrames => "no frame could be read".to_owned(),
        E::OneFrame { .. } => "noise at rest shows in the difference of frames: choose two or more".to_owned(),
        E::TooManyFrames { .. } => "too many frames at once: choose fewer".to_owned(),
        E::Size { expected, actual } => format!("the frames differ in size: {actual} beside {expected} px"),
        E::Depth { expected, actual } => format!("the frames differ in depth: {actual} beside {expected} bits a channel"),
        E::Empty => "the frame has no pixels".to_owned(),
        E::TooLarge { actual } => format!("a frame of {actual} px is too large to be summed up: pick smaller places"),
        E::Stopped => "it was cancelled".to_owned(),
        E::Bins { .. } | E::MeansMixed | E::MeansCount { .. } => without_options(&error.to_string()),
        E::TooFew { channel, needed, best } => {
            format!("{} too few pixels of one brightness, in {}", samples(*best, *needed), channel_name(channel))
        }
        E::Textured { channel, needed, best, .. } => {
            let samples = samples(*best, *needed);
            format!(
                "texture is almost everywhere in this frame, above all in {}: {samples} uniform pixels",
                channel_name(channel)
            )
        }
        E::CameraMoves { percent, .. } => format!(
            "the camera moves in these frames ({} % of the change is one common motion): choose frames at rest, or \
             measure each place in its own frame",
            fixed(*percent, 0)
        ),
        E::SceneChanges { .. } | E::WrongMean { .. } => {
            "too much moves or changes in these frames: choose frames at rest, or measure each place in its own frame"
                .to_owned()
        }
        E::NeverAtRest { .. } => {
            "no scene at rest was found in these frames: hold the camera still for two seconds, or measure each place in its own \
             frame"
                .to_owned()
        }
        E::Read { path, reason } => format!("{}: {reason}", path.display()),
        E::Picture(error) => without_options(&error.to_string()),
        E::InFile { path, source } => format!("{}: {}", path.display(), noise_error(source)),
    }
}

/// Why the noise could not be measured from picked places.
pub fn picked_error(error: &PickedError) -> String {
    match error {
        PickedError::Calibrate(error) => noise_error(error),
        other => other.to_string(),
    }
}

/// A warning about noise from picked places. `used`: numbers of the places that count, from 1.
pub fn noise_warning(warning: &Warning, used: &[usize]) -> String {
    use Warning as W;
    // Each place is a scene of its own.
    let place = |scene: &usize| match scene.checked_sub(1).and_then(|n| used.get(n)) {
        Some(n) => format!("area {n}: "),
        None => String::new(),
    };
    match warning {
        W::Unsteady { scene, percent, .. } => format!(
            "{}the picture moves a little from frame to frame ({} % of the change), and σ is too large: choose frames \
             in which the camera stands still",
            place(scene),
            fixed(*percent, 0)
        ),
        W::Moving { scene, percent } => {
            format!("{}{} % of it moves or drifts, and is left out", place(scene), fixed(*percent, 0))
        }
        W::Filtered { scene, percent } => format!(
            "{}consecutive frames are correlated ({} % of the variance): the camera filters over time, or the light \
             drifts",
            place(scene),
            fixed(*percent, 0)
        ),
        W::Flicker { scene, codes } => format!(
            "{}its brightness varies by {} pixel values from frame to frame: flicker or automatic exposure counts as noise",
            place(scene),
            fixed(*codes, 2)
        ),
        W::Filled { channel, filled, bins, .. } => format!(
            "{}: {filled} of {} had too few pixels, and follow their neighbours",
            channel_name(channel),
            count(*bins, "intensity range")
        ),
        W::OffMean { channel, code, off } => {
            format!(
                "{}: at pixel value {} the frames lie {} beside their mean",
                channel_name(channel),
                fixed(*code, 0),
                fixed(*off, 1)
            )
        }
        W::NoCorrelation(of) => format!("the correlation of pixels ({of}) is too weak to be measured: 0 is used"),
        W::LowCorrelation { of, measured, written } => format!(
            "the correlation of pixels ({of}) is {}, impossible for noise: {written} is used; does the camera sharpen?",
            fixed(*measured, 2)
        ),
        W::Texture => "the intervals are those of chance: texture that is everywhere counts as noise".to_owned(),
        W::Stretch { .. } | W::LeftOut { .. } | W::NoSceneAtRest => without_options(&warning.to_string()),
        W::Jpeg => "the frames are JPEG, which has changed their noise".to_owned(),
    }
}

/// Name of a channel, as on the buttons.
fn channel_name(channel: &str) -> &str {
    match channel {
        "R" => "red",
        "G" => "green",
        "B" => "blue",
        other => other,
    }
}

/// Number of independent samples and the required number.
fn samples(best: f64, needed: f64) -> String {
    format!("{} of the {} that are needed:", fixed(best, 0), fixed(needed, 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_mention_neither_options_nor_scenes() {
        let (channel, path) = ("G", std::path::PathBuf::from("/r/frame.png"));
        let textured = || CalibrateError::Textured { channel, needed: 300.0, best: 41.6, frames: 1 };
        let errors = [
            CalibrateError::NoFrames,
            CalibrateError::OneFrame { scene: 2 },
            CalibrateError::TooManyFrames { scene: 2 },
            CalibrateError::TooFew { channel, needed: 300.0, best: 12.0 },
            textured(),
            CalibrateError::CameraMoves { scene: 2, percent: 61.0 },
            CalibrateError::SceneChanges { scene: 2, percent: 61.0 },
            CalibrateError::WrongMean { scene: 2, percent: 61.0 },
            CalibrateError::TooLarge { actual: "9x9".to_owned() },
            CalibrateError::InFile { path, source: Box::new(CalibrateError::OneFrame { scene: 1 }) },
        ];
        let warnings = [
            Warning::Unsteady { scene: 2, percent: 3.0, known_mean: true },
            Warning::Moving { scene: 2, percent: 3.0 },
            Warning::Filtered { scene: 2, percent: 3.0 },
            Warning::Flicker { scene: 2, codes: 0.5 },
            Warning::Filled { channel, needed: 300.0, filled: 3, bins: 16 },
            Warning::OffMean { channel, code: 10.0, off: 2.0 },
            Warning::NoCorrelation("to the right"),
            Warning::LowCorrelation { of: "below", measured: -0.2, written: 0.0 },
            Warning::Texture,
            Warning::Jpeg,
        ];
        let message =
            errors.iter().map(noise_error).chain(warnings.iter().map(|warning| noise_warning(warning, &[1, 4])));
        for text in message {
            let is_plain = !["--", "scene", "given", "picture of the", " G", " bins"]
                .iter()
                .any(|noise_warning| text.contains(noise_warning));
            assert!(is_plain, "{text}");
        }
        // The second place that counts is the fourth one picked.
        assert!(noise_warning(&warnings[3], &[1, 4]).starts_with("area 4: its brightness varies by 0.50 pixel values"));
        let message = picked_error(&PickedError::Calibrate(textured()));
        assert!(message.contains("green") && message.contains("42 of the 300 that are needed"), "{message}");
    }
}
