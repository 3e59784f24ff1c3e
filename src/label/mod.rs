//! Labels of pictures that are not photographs: the IPTC digital source type, the program and the
//! frame as XMP, in the place where each file format has it.
//!
//! Sources: IPTC Photo Metadata Standard 2023.1, Digital Source Type, and its NewsCodes; ISO
//! 16684-1 (XMP) and the XMP Specification Part 3 (storage in files).
//!
//! A label is not signed: whoever edits a file can remove it.

mod iso_media;
mod jpeg;
mod png;

use std::ops::Range;

pub use iso_media::append_box;
pub use jpeg::with_packet;
pub use png::{Chunk, with_chunks, xmp_chunk};

/// Origin of a picture, by the IPTC's NewsCodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DigitalSourceType {
    /// Footage with virtual objects.
    CompositeWithSyntheticElements,
    /// A rendering without footage.
    DigitalCreation,
    /// A drawing of data: text and figures.
    DataDrivenMedia,
}

impl DigitalSourceType {
    pub const ALL: [Self; 3] = [Self::CompositeWithSyntheticElements, Self::DigitalCreation, Self::DataDrivenMedia];

    /// The concept's address.
    pub fn uri(self) -> &'static str {
        match self {
            Self::CompositeWithSyntheticElements => "http://cv.iptc.org/newscodes/digitalsourcetype/compositeSynthetic",
            Self::DigitalCreation => "http://cv.iptc.org/newscodes/digitalsourcetype/digitalCreation",
            Self::DataDrivenMedia => "http://cv.iptc.org/newscodes/digitalsourcetype/dataDrivenMedia",
        }
    }

    /// A sentence for people.
    pub fn description(self) -> &'static str {
        match self {
            Self::CompositeWithSyntheticElements => "Composite with synthetic elements: footage with virtual objects",
            Self::DigitalCreation => "Digital creation: a rendering of virtual objects",
            Self::DataDrivenMedia => "Data-driven media: text and colour patches drawn from the data of a case",
        }
    }
}

/// Name and version of the program.
pub const PROGRAM: &str = concat!("Locard ", env!("CARGO_PKG_VERSION"));

/// Label of a picture or of a video.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceLabel {
    pub source_type: DigitalSourceType,
    /// File name of the recording.
    pub recording: Option<String>,
    /// Index of the frame in the recording; `None` for a video.
    pub frame: Option<usize>,
    /// Half-open range of a video's frames in the recording.
    pub frames: Option<Range<usize>>,
}

impl SourceLabel {
    /// Label of composites into a recording.
    pub fn composite(recording: &std::path::Path) -> Self {
        let recording = recording.file_name().map(|name| name.to_string_lossy().into_owned());
        Self { recording, source_type: DigitalSourceType::CompositeWithSyntheticElements, ..Self::rendering() }
    }

    /// Label of renderings of a scene alone.
    pub fn rendering() -> Self {
        Self { source_type: DigitalSourceType::DigitalCreation, recording: None, frame: None, frames: None }
    }

    /// Label of a case card.
    pub fn case_card() -> Self {
        Self { source_type: DigitalSourceType::DataDrivenMedia, ..Self::rendering() }
    }

    /// The label of one frame.
    pub fn of_frame(&self, frame: usize) -> Self {
        Self { frame: Some(frame), frames: None, ..self.clone() }
    }

    /// The label of a video of a range of frames.
    pub fn of_frames(&self, frames: Range<usize>) -> Self {
        Self { frame: None, frames: Some(frames), ..self.clone() }
    }

    /// The XMP packet: ASCII but for the byte order mark of its head. It is the same for the same
    /// label.
    pub fn xmp(&self) -> String {
        let recording = self.recording.iter().map(|name| format!("\n   locard:recording=\"{}\"", xml_escaped(name)));
        let frame = self.frame.iter().map(|frame| format!("\n   locard:frame=\"{frame}\""));
        let frames = self.frames.iter().map(|range| format!("\n   locard:frames=\"{}..{}\"", range.start, range.end));
        let own: String = recording.chain(frame).chain(frames).collect();
        format!(
            "<?xpacket begin=\"\u{feff}\" id=\"W5M0MpCehiHzreSzNTczkc9d\"?>\n\
             <x:xmpmeta xmlns:x=\"adobe:ns:meta/\">\n \
             <rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\n  \
             <rdf:Description rdf:about=\"\"\n   \
             xmlns:dc=\"http://purl.org/dc/elements/1.1/\"\n   \
             xmlns:xmp=\"http://ns.adobe.com/xap/1.0/\"\n   \
             xmlns:Iptc4xmpExt=\"http://iptc.org/std/Iptc4xmpExt/2008-02-29/\"\n   \
             xmlns:locard=\"urn:locard:label:1#\"\n   \
             xmp:CreatorTool=\"{PROGRAM}\"\n   \
             Iptc4xmpExt:DigitalSourceType=\"{}\"{own}>\n   \
             <dc:description><rdf:Alt><rdf:li xml:lang=\"x-default\">{}</rdf:li></rdf:Alt></dc:description>\n  \
             </rdf:Description>\n </rdf:RDF>\n</x:xmpmeta>\n<?xpacket end=\"r\"?>",
            self.source_type.uri(),
            self.source_type.description(),
        )
    }
}

/// A text as the value of an XML attribute, in ASCII.
fn xml_escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            // Characters that XML 1.0 has not: the replacement character.
            odd if odd.is_control() || matches!(odd, '\u{fffe}' | '\u{ffff}') => out.push_str("&#65533;"),
            ascii if ascii.is_ascii() => out.push(ascii),
            other => out.push_str(&format!("&#{};", u32::from(other))),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packet_is_xml_with_the_source_type_program_recording_and_frame() {
        let label = SourceLabel::composite(std::path::Path::new("/tmp/ä \"b\" & <c>\u{1}")).of_frame(12);
        let xmp = label.xmp();
        let document = roxmltree::Document::parse(xmp.trim_start_matches('\u{feff}')).unwrap();
        let description = document.descendants().find(|node| node.has_tag_name("Description")).unwrap();
        let value = |namespace: &str, name: &str| description.attribute((namespace, name)).unwrap();
        let iptc = value("http://iptc.org/std/Iptc4xmpExt/2008-02-29/", "DigitalSourceType");
        assert_eq!(iptc, "http://cv.iptc.org/newscodes/digitalsourcetype/compositeSynthetic");
        assert_eq!(value("http://ns.adobe.com/xap/1.0/", "CreatorTool"), PROGRAM);
        assert_eq!(value("urn:locard:label:1#", "recording"), "ä \"b\" & <c>\u{fffd}");
        assert_eq!(value("urn:locard:label:1#", "frame"), "12");
        let of_range = label.of_frames(40..46);
        assert!(of_range.xmp().contains("locard:frames=\"40..46\"") && !of_range.xmp().contains("locard:frame="));
        assert_eq!(of_range.of_frame(12), label);
        let of_video = SourceLabel::rendering().xmp();
        assert!(of_video.contains("digitalCreation") && !of_video.contains("locard:frame"));
    }
}
