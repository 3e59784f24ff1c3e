//! WGSL sources, embedded, and their one-line import.
//!
//! `// @import shared/hash` on a line of its own stands for that file's text, once a module.

/// Every shader of the program by the path below shaders/, without `.wgsl`.
pub fn sources() -> &'static [(&'static str, &'static str)] {
    macro_rules! embed {
        ($($name:literal),* $(,)?) => { &[$(($name, include_str!(concat!("../../shaders/", $name, ".wgsl")))),*] };
    }
    embed![
        "shared/fullscreen",
        "shared/half",
        "shared/hash",
        "shared/highlights",
        "shared/layer",
        "shared/lens",
        "shared/response",
        "shared/mixed",
        "shared/noise",
        "accumulate",
        "accumulated",
        "around",
        "behind_real",
        "chromatic_aberration",
        "chromatic_aberration_over",
        "composite",
        "composite_real",
        "copy",
        "depth_of_field",
        "depth_of_field_diffusion",
        "depth_of_field_highlights",
        "depth_of_field_poisson",
        "depth_of_field_pyramid",
        "depth_of_field_slices",
        "depth_of_field_surroundings",
        "depth_of_field_tiles",
        "edge_blend",
        "exposure",
        "motion_blur",
        "motion_blur_tiles",
        "noise",
        "noise_grain",
        "noise_pattern",
        "noise_white",
        "point_spread",
        "raster",
        "real_part",
        "resolve",
        "vignetting",
    ]
}

/// The module of a name, with its imports.
///
/// # Panics
/// Where the name, or one that is imported, is not in [`sources`]: a slip of ours that the shader test finds.
pub fn assemble(name: &str) -> String {
    expand(source(name), &mut Vec::new())
}

/// A text with its imports, but for those `seen` already, for modules of several texts; what it imports is seen then.
///
/// # Panics
/// Where a name that is imported is not in [`sources`].
pub fn expand<'a>(text: &'a str, seen: &mut Vec<&'a str>) -> String {
    let mut out = String::new();
    append(text, seen, &mut out);
    out
}

/// The text of a name, without its imports.
///
/// # Panics
/// Where it is not in [`sources`].
pub fn source(name: &str) -> &'static str {
    let found = sources().iter().find(|(n, _)| *n == name);
    found.map(|(_, text)| *text).unwrap_or_else(|| panic!("no shader is called {name}"))
}

fn append<'a>(text: &'a str, seen: &mut Vec<&'a str>, out: &mut String) {
    for line in text.lines() {
        let Some(name) = line.trim().strip_prefix("// @import ") else {
            out.push_str(line);
            out.push('\n');
            continue;
        };
        if !seen.contains(&name) {
            seen.push(name);
            append(source(name), seen, out);
        }
    }
}

/// The number that a text of WGSL has as `const NAME`, for tests that compare it with ours.
#[cfg(test)]
pub fn constant(wgsl: &str, name: &str) -> f64 {
    let line = wgsl.lines().find_map(|l| l.strip_prefix("const ")?.strip_prefix(name)?.strip_prefix(": ")).expect(name);
    let (_, value) = line.split_once("= ").expect(name);
    value.trim_end_matches(['u', ';']).parse().expect(name)
}
