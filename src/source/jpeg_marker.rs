//! Markers of a JPEG file (ITU-T T.81, annex B.1.1.2).

/// Reason why pictures with this frame header (marker SOF, sample precision) are not decoded.
/// `None` if they are.
pub fn unsupported(marker: u8, bits: u8) -> Option<String> {
    let (kind, convert) = match marker {
        0xc9..=0xcb | 0xcd..=0xcf => ("an arithmetic-coded JPEG", "jpegtran -optimize FILE.jpg > NEW.jpg"),
        0xc3 | 0xc7 => ("a lossless JPEG", "ffmpeg -i FILE.jpg NEW.png"),
        0xf7 => ("a JPEG-LS picture", "ffmpeg -i FILE.jpg NEW.png"),
        0xc5 | 0xc6 => ("a hierarchical JPEG", "magick FILE.jpg NEW.png"),
        _ if bits == 8 => return None,
        _ => ("a JPEG of more than 8 bits", "djpeg FILE.jpg > NEW.ppm; ffmpeg -i NEW.ppm NEW.png"),
    };
    Some(format!("is {kind}, which is not supported; convert it: {convert}"))
}

/// Whether a marker begins a frame header (SOF): C0 to CF without DHT, JPG and DAC; F7 of JPEG-LS
/// (ITU-T T.87, annex C).
pub fn is_frame(marker: u8) -> bool {
    matches!(marker, 0xc0..=0xcf | 0xf7) && !matches!(marker, 0xc4 | 0xc8 | 0xcc)
}

/// The next marker, skipping anything before it; `at` is moved past it.
pub fn next_marker(bytes: &[u8], at: &mut usize) -> Option<u8> {
    loop {
        let pair = bytes.get(*at..*at + 2)?;
        if pair[0] == 0xff && !matches!(pair[1], 0x00 | 0xff) {
            *at += 2;
            return Some(pair[1]);
        }
        *at += 1;
    }
}
