//! Exports a sheet for printing: PDF 1.4, or PNG at 300 dots per inch.

use std::fmt::Write as _;

use glam::DVec2;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError, Rgb, RgbImage};

use super::sheet::{Sheet, SheetMark, SheetRect};
use crate::sink::lettering::{self, Style};

const DOTS_PER_INCH: f64 = 300.0;
const MM_PER_INCH: f64 = 25.4;
const POINTS_PER_MM: f64 = 72.0 / MM_PER_INCH;

/// A vector page with a standard font of every reader. It requests printing without scaling.
pub fn pdf(sheet: &Sheet) -> Vec<u8> {
    let size = POINTS_PER_MM * sheet.paper.size_mm();
    let mut drawn = format!("{POINTS_PER_MM:.9} 0 0 {POINTS_PER_MM:.9} 0 0 cm\n");
    for mark in &sheet.marks {
        match mark {
            SheetMark::Black(rects) => filled(&mut drawn, 0, rects),
            SheetMark::White(rects) => filled(&mut drawn, 1, rects),
            SheetMark::Text { at_mm, height_mm, text } => {
                let text: String = text
                    .chars()
                    .flat_map(|c| (matches!(c, '(' | ')' | '\\')).then_some('\\').into_iter().chain([c]))
                    .collect();
                let _ = writeln!(drawn, "0 g BT /F {height_mm} Tf {:.4} {:.4} Td ({text}) Tj ET", at_mm.x, at_mm.y);
            }
        }
    }
    let parts = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        format!(
            "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.3} {:.3}] /Contents 4 0 R /Resources << /Font << /F 5 0 R >> >> >>",
            size.x, size.y
        ),
        format!("<< /Length {} >>\nstream\n{drawn}endstream", drawn.len()),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
    ];
    let mut file = "%PDF-1.4\n".to_owned();
    let mut table = format!("xref\n0 {}\n0000000000 65535 f \n", parts.len() + 1);
    for (i, part) in parts.iter().enumerate() {
        let _ = writeln!(table, "{:010} 00000 n ", file.len());
        let _ = write!(file, "{} 0 obj\n{part}\nendobj\n", i + 1);
    }
    let begins = file.len();
    let _ = write!(file, "{table}trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{begins}\n%%EOF\n", parts.len() + 1);
    file.into_bytes()
}

fn filled(drawn: &mut String, grey: u8, rects: &[SheetRect]) {
    let _ = write!(drawn, "{grey} g");
    for SheetRect { at_mm, size_mm } in rects {
        let _ = write!(drawn, " {:.5} {:.5} {:.5} {:.5} re", at_mm.x, at_mm.y, size_mm.x, size_mm.y);
    }
    drawn.push_str(" f\n");
}

/// Rasterizes the sheet. A partly covered dot has the light of its uncovered share.
pub fn picture(sheet: &Sheet) -> RgbImage {
    let page = sheet.paper.size_mm();
    let px = DOTS_PER_INCH / MM_PER_INCH;
    let size = (px * page).round();
    let (width, height) = (size.x as u32, size.y as u32);
    let mut light = vec![1.0f32; width as usize * height as usize];
    for mark in &sheet.marks {
        let (grey, rects) = match mark {
            SheetMark::Black(rects) => (0.0, rects),
            SheetMark::White(rects) => (1.0, rects),
            SheetMark::Text { .. } => continue,
        };
        // The shares of a dot are summed, so that there are no seams.
        let mut covered = vec![0.0f32; light.len()];
        for SheetRect { at_mm, size_mm } in rects {
            let low = DVec2::new(at_mm.x, page.y - at_mm.y - size_mm.y) * px;
            let high = low + *size_mm * px;
            for y in low.y as u32..(high.y.ceil() as u32).min(height) {
                let tall = (high.y.min(f64::from(y) + 1.0) - low.y.max(f64::from(y))).max(0.0);
                for x in low.x as u32..(high.x.ceil() as u32).min(width) {
                    let wide = (high.x.min(f64::from(x) + 1.0) - low.x.max(f64::from(x))).max(0.0);
                    covered[y as usize * width as usize + x as usize] += (wide * tall) as f32;
                }
            }
        }
        for (light, covered) in light.iter_mut().zip(covered) {
            *light += (grey - *light) * covered.min(1.0);
        }
    }
    let response = crate::camera::Response::default();
    let mut picture = RgbImage::from_fn(width, height, |x, y| {
        let light = light[y as usize * width as usize + x as usize];
        Rgb([(255.0 * response.encode(light.into())).round() as u8; 3])
    });
    for mark in &sheet.marks {
        if let SheetMark::Text { at_mm, height_mm, text } = mark {
            // The font's height is from the lowest to the highest letter; its base line lies a
            // quarter of that higher.
            let height = 1.3 * height_mm * px;
            let at = ((at_mm.x * px) as f32, ((page.y - at_mm.y) * px - 0.78 * height) as f32);
            let style = Style { height_px: height as f32, ink: Rgb([0; 3]) };
            lettering::write(&mut picture, at, width as f32, text, style);
        }
    }
    picture
}

/// [`picture`] as a PNG file with its physical size.
pub fn png(sheet: &Sheet) -> Result<Vec<u8>, ImageError> {
    let picture = picture(sheet);
    let mut file = Vec::new();
    PngEncoder::new(&mut file).write_image(
        picture.as_raw(),
        picture.width(),
        picture.height(),
        ExtendedColorType::Rgb8,
    )?;
    // After the signature (8 bytes) and the header's chunk (25): dots per metre (PNG specification,
    // 11.3.4.3).
    let dots = ((1e3 * DOTS_PER_INCH / MM_PER_INCH).round() as u32).to_be_bytes();
    let mut chunk = b"pHYs".to_vec();
    chunk.extend(dots.iter().chain(&dots).chain(&[1]));
    let sum = crc32fast::hash(&chunk).to_be_bytes();
    let length = (chunk.len() as u32 - 4).to_be_bytes();
    let at = 33.min(file.len());
    file.splice(at..at, length.into_iter().chain(chunk).chain(sum));
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::super::sheet::Paper;
    use super::*;

    #[test]
    fn pdf_has_a_cross_reference_table_of_its_objects() {
        let sheet = Sheet::new(Paper::Letter);
        let file = String::from_utf8(pdf(&sheet)).unwrap();
        let at = |n: usize| file.find(&format!("{n} 0 obj")).unwrap();
        let table: Vec<&str> = file[file.rfind("xref\n0 6").unwrap()..].lines().collect();
        for n in 1..6 {
            assert_eq!(table[n + 2], format!("{:010} 00000 n ", at(n)));
        }
        assert!(file.ends_with(&format!("startxref\n{}\n%%EOF\n", file.find("xref\n0 6").unwrap())));
        let stream = &file[file.find("stream\n").unwrap() + 7..file.find("endstream").unwrap()];
        assert!(file.contains(&format!("/Length {} ", stream.len())));
        // Letter, in points; six tags and their cells.
        assert!(file.contains("/MediaBox [0 0 612.000 792.000]"));
        let cells: usize = (0..6).map(|id| sheet.board.family.white_cells(id).unwrap().len()).sum();
        assert_eq!(stream.matches(" re").count(), 6 + cells + 2 + 32);
    }

    #[test]
    fn png_has_its_tags_in_place_and_a_physical_size() {
        let sheet = Sheet::new(Paper::A4);
        let picture = picture(&sheet);
        assert_eq!(picture.dimensions(), (2480, 3508));
        let at = |x_mm: f64, y_mm: f64| {
            picture.get_pixel((x_mm / 25.4 * 300.0) as u32, ((297.0 - y_mm) / 25.4 * 300.0) as u32)[0]
        };
        // The upper left tag's black square begins 30 mm from the left and 12 mm from the top.
        assert_eq!([at(29.5, 260.0), at(30.5, 260.0), at(94.5, 260.0), at(95.5, 260.0)], [255, 0, 0, 255]);
        assert_eq!([at(60.0, 285.5), at(60.0, 284.5), at(60.0, 220.5), at(60.0, 219.5)], [255, 0, 0, 255]);
        // Its second cell from the left in the second row is white, the third from there is not.
        let cell = 65.0 / 8.0;
        assert_eq!([1.5, 3.5].map(|i| at(30.0 + i * cell, 285.0 - 1.5 * cell)), [255, 0]);
        // Seams would be grey.
        assert_eq!(at(30.0 + 2.0 * cell, 285.0 - 1.5 * cell), 255);
        let file = png(&sheet).unwrap();
        assert_eq!(&file[37..41], b"pHYs");
        assert_eq!(&file[41..50], [0, 0, 0x2e, 0x23, 0, 0, 0x2e, 0x23, 1], "11811 dots per metre");
        let read = image::load_from_memory(&file).unwrap();
        assert_eq!(read.into_rgb8(), picture);
    }
}
