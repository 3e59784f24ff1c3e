//! Numbers in messages.

/// How many there are of a thing, as in "1 sun", "2 suns".
pub fn count(number: usize, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// Why a file could not be read or written, and what to do about it where that is known.
pub fn reason(error: &std::io::Error) -> String {
    use std::io::ErrorKind;
    let text = match error.kind() {
        ErrorKind::StorageFull => "the disk is full; make room, or write elsewhere",
        ErrorKind::BrokenPipe => "whoever was reading has closed it",
        ErrorKind::NotFound => "there is no such file or folder; check the path",
        ErrorKind::PermissionDenied => "it is not permitted; check whose file it is",
        ErrorKind::IsADirectory => "it is a folder; name a file",
        ErrorKind::InvalidData => "it is not text in UTF-8; check that it is the file meant",
        _ => return error.to_string(),
    };
    text.to_owned()
}

/// A unit behind a number, with a blank before it; nothing for pure numbers and text.
pub fn shown_unit(unit: &str) -> String {
    if matches!(unit, "" | "1") { String::new() } else { format!(" {unit}") }
}

/// At most six significant digits, no zeros behind them.
pub fn short(number: f64) -> String {
    let whole_digits = number.abs().max(1e-9).log10().floor() as i32 + 1;
    let rounded = format!("{number:.*}", (6 - whole_digits).clamp(0, 12) as usize);
    match rounded.contains('.') {
        true => rounded.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => rounded,
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn one_is_not_many() {
        assert_eq!([0, 1, 2].map(|n| super::count(n, "sun")), ["0 suns", "1 sun", "2 suns"]);
    }

    #[test]
    fn short_numbers() {
        let cases =
            [(1.0 / 60.0, "0.0166667"), (525.0, "525"), (0.0, "0"), (-0.0004, "-0.0004"), (1234567.0, "1234567")];
        for (number, text) in cases {
            assert_eq!(super::short(number), text);
        }
    }
}
