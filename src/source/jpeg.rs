//! Checks that a JPEG's coded data is complete.
//!
//! Decoders conceal missing data with grey, or by repeating the last column. So the entropy-coded
//! data is parsed without decoding: a scan is complete if it has every block that the header
//! promises. Source: ITU-T T.81 (Huffman codes: annex C and F.2.2; scans and restarts: annex B and
//! E; progressive scans: annex G).
//!
//! Arithmetic coding, lossless and hierarchical files, JPEG-LS, and 12 bits are not supported:
//! [`unsupported`] refuses them. Not checked: whether a progressive file that ends between two
//! scans should have had more of them.

use super::jpeg_header::{FrameHeader, PlaneHeader, QuantizationTables, parse_quantization};
use super::jpeg_marker::{is_frame, next_marker, unsupported};

/// Ending of a complete picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    Marked,
    /// All blocks are present, but not the end marker: some cameras omit it.
    Unmarked,
}

/// Pictures with more units than this (2³⁰ pixels or more) are not checked.
const MAX_BLOCKS: usize = 1 << 24;
/// Length of the prefix by which most Huffman codes are looked up directly, bits.
const LOOKUP_BITS: u32 = 9;
/// More scans than this are refused: each passes over all blocks, however few bits it has, and
/// encoders make about ten.
const MAX_SCANS: usize = 100;

/// Why a scan ended early.
enum ScanStop {
    /// The data ended, or a marker is in its place.
    Ended,
    /// Bits that are not a valid code.
    Invalid,
}

/// Parses a JPEG's coded data. The error describes the truncation or damage.
pub fn check(bytes: &[u8]) -> Result<Ending, String> {
    let mut file = JpegReader { bytes, ..JpegReader::default() };
    let (mut at, mut scans) = (2, 0);
    while let Some(marker) = next_marker(bytes, &mut at) {
        match marker {
            0xd9 => return file.end(Ending::Marked),
            0x01 | 0xd0..=0xd8 => continue,
            _ => {}
        }
        let length = bytes.get(at..at + 2).map_or(0, |l| usize::from(u16::from_be_bytes([l[0], l[1]])));
        let Some(segment) = bytes.get(at + 2..at + length) else { return Err(truncated(" in its header")) };
        at += length;
        if is_frame(marker)
            && let Some(problem) = unsupported(marker, segment.first().copied().unwrap_or(8))
        {
            return Err(problem);
        }
        match marker {
            0xc0..=0xc2 if file.components.is_empty() => match file.frame(segment, marker == 0xc2) {
                Some(()) => {}
                None => return Ok(Ending::Marked),
            },
            0xc0..=0xc2 => return Ok(Ending::Marked),
            0xc4 => file.tables(segment).ok_or_else(|| DAMAGED.to_owned())?,
            0xdb => {
                parse_quantization(segment, &mut file.quantizations).ok_or_else(|| DAMAGED.to_owned())?;
            }
            0xdd => file.restart_every = segment.first_chunk().map_or(0, |n| usize::from(u16::from_be_bytes(*n))),
            0xda if scans == MAX_SCANS => {
                return Err(format!("the JPEG has more than {MAX_SCANS} scans; save it again"));
            }
            0xda => {
                at = file.scan(segment, at)?;
                scans += 1;
            }
            _ => {}
        }
    }
    file.end(Ending::Unmarked)
}

const NO_QUANTIZATION: &str = "the JPEG has no quantisation tables (an abbreviated file, whose tables are in another \
                               one): extract the pictures again, with their tables";
const DAMAGED: &str = "the JPEG is damaged: its coded data is invalid";

fn truncated(how: &str) -> String {
    format!("the JPEG is truncated{how}")
}

/// The state of reading a JPEG file.
#[derive(Default)]
struct JpegReader<'a> {
    bytes: &'a [u8],
    is_progressive: bool,
    size: [usize; 2],
    components: Vec<JpegComponent>,
    /// Tables for DC differences, and for the AC coefficients.
    huffman: [[Option<HuffmanTable>; 4]; 2],
    quantizations: QuantizationTables,
    restart_every: usize,
}

/// A colour component and its progressive state.
struct JpegComponent {
    header: PlaneHeader,
    /// Whether a scan contained its DC coefficients.
    has_dc: bool,
    /// Bit masks of the coefficients of each block of a progressive file that are known to be
    /// nonzero.
    nonzero: Vec<u64>,
}

impl JpegComponent {
    fn new(header: PlaneHeader) -> Self {
        Self { header, has_dc: false, nonzero: Vec::new() }
    }
}

/// The part of each block's coefficients that a scan codes.
#[derive(Clone, Copy)]
struct SpectralBand {
    first: u32,
    last: u32,
    is_refined: bool,
}

impl JpegReader<'_> {
    /// `None` if the frame is not of a kind that is checked.
    fn frame(&mut self, segment: &[u8], is_progressive: bool) -> Option<()> {
        let header = FrameHeader::parse(segment)?;
        self.is_progressive = is_progressive;
        self.size = header.size;
        self.components = header.planes.into_iter().map(JpegComponent::new).collect();
        let fits = self.components.iter().all(|c| c.header.sampling.iter().all(|s| (1..=4).contains(s)));
        let [across, down] = self.units();
        (fits && across * down > 0 && across * down <= MAX_BLOCKS).then_some(())
    }

    /// Blocks per unit of the component with the finest sampling.
    fn finest(&self, axis: usize) -> usize {
        self.components.iter().map(|c| c.header.sampling[axis]).max().unwrap_or(1)
    }

    /// Units across and down, each containing blocks of all components.
    fn units(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.size[axis].div_ceil(8 * self.finest(axis).max(1)))
    }

    fn tables(&mut self, mut segment: &[u8]) -> Option<()> {
        while let Some((&kind, rest)) = segment.split_first() {
            let (lengths, rest) = rest.split_first_chunk::<16>()?;
            let count = lengths.iter().map(|&n| usize::from(n)).sum();
            let symbols = rest.get(..count)?;
            *self.huffman.get_mut(usize::from(kind >> 4))?.get_mut(usize::from(kind & 15))? =
                Some(HuffmanTable::new(lengths, symbols)?);
            segment = rest.get(count..)?;
        }
        Some(())
    }

    fn end(&self, ending: Ending) -> Result<Ending, String> {
        if self.components.is_empty() || !self.components.iter().all(|c| c.has_dc) {
            return Err(truncated(": scans are missing"));
        }
        if ending == Ending::Unmarked && self.is_progressive {
            return Err(truncated(": its end marker is missing"));
        }
        Ok(ending)
    }

    /// Walks through a scan whose data begins at `at`; returns where it ends.
    fn scan(&mut self, segment: &[u8], at: usize) -> Result<usize, String> {
        let damaged = || DAMAGED.to_owned();
        let count = usize::from(*segment.first().ok_or_else(damaged)?);
        let parts = segment.get(1..1 + 2 * count).ok_or_else(damaged)?;
        let Some(&[first, last, high_low]) = segment.get(1 + 2 * count..4 + 2 * count).and_then(|s| s.first_chunk())
        else {
            return Err(damaged());
        };
        let band = match self.is_progressive {
            false => SpectralBand { first: 0, last: 63, is_refined: false },
            true => SpectralBand { first: first.into(), last: last.min(63).into(), is_refined: high_low >> 4 > 0 },
        };
        let mut chosen = Vec::new();
        for part in parts.chunks_exact(2) {
            let index = self.components.iter().position(|c| c.header.id == part[0]).ok_or_else(damaged)?;
            let table = self.quantizations.get(usize::from(self.components[index].header.quantization));
            if table.is_none_or(Option::is_none) {
                return Err(NO_QUANTIZATION.to_owned());
            }
            chosen.push((index, [usize::from(part[1] >> 4), usize::from(part[1] & 15)]));
        }
        let units = self.units();
        for &(index, _) in &chosen {
            let component = &mut self.components[index];
            component.has_dc |= band.first == 0;
            if self.is_progressive && component.nonzero.is_empty() {
                component.nonzero =
                    vec![0; units[0] * units[1] * component.header.sampling[0] * component.header.sampling[1]];
            }
        }
        // A scan of one component has only the blocks inside the picture, without those that fill
        // up units.
        let grid = match chosen.as_slice() {
            [(index, _)] => {
                let sampling = self.components[*index].header.sampling;
                [0, 1].map(|axis| (self.size[axis] * sampling[axis]).div_ceil(self.finest(axis)).div_ceil(8))
            }
            _ => units,
        };
        let mut bits = Bits { bytes: self.bytes, at, buffer: 0, count: 0 };
        let mut run = 0;
        let total = grid[0] * grid[1];
        for unit in 0..total {
            let stopped = |stop| match stop {
                ScanStop::Ended => {
                    truncated(&format!(" after {:.0} % of its data", 100.0 * unit as f64 / total as f64))
                }
                ScanStop::Invalid => DAMAGED.to_owned(),
            };
            if self.restart_every > 0 && unit > 0 && unit % self.restart_every == 0 {
                bits.restart().map_err(stopped)?;
                run = 0;
            }
            for &(index, tables) in &chosen {
                let component = &mut self.components[index];
                let alone = chosen.len() == 1;
                let [h, v] = if alone { [1, 1] } else { component.header.sampling };
                let width = units[0] * component.header.sampling[0];
                let [dc, ac] = [0, 1].map(|kind| self.huffman[kind].get(tables[kind]).and_then(Option::as_ref));
                for block in 0..h * v {
                    let (x, y) = (unit % grid[0] * h + block % h, unit / grid[0] * v + block / h);
                    let walked = match component.nonzero.get_mut(y * width + x) {
                        Some(nonzero) => bits.progressive(dc, ac, band, nonzero, &mut run),
                        None => bits.sequential(dc, ac),
                    };
                    walked.map_err(stopped)?;
                }
            }
        }
        Ok(bits.at)
    }
}

/// A Huffman table: symbols by code (T.81, annex C and F.2.2.3).
struct HuffmanTable {
    /// Length and symbol for each prefix of a code; length 0 if the code is longer.
    lookup: Vec<(u8, u8)>,
    /// One past the last code of each length, and the offset from a code to its index in `symbols`.
    ends: [(u32, i32); 17],
    symbols: Vec<u8>,
}

impl HuffmanTable {
    fn new(lengths: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut lookup = vec![(0, 0); 1 << LOOKUP_BITS];
        let mut ends = [(0, 0); 17];
        let (mut code, mut place) = (0u32, 0usize);
        for length in 1..=16u32 {
            let count = usize::from(lengths[length as usize - 1]);
            for &symbol in symbols.get(place..place + count)? {
                if length <= LOOKUP_BITS {
                    let spare = LOOKUP_BITS - length;
                    let from = (code as usize) << spare;
                    lookup.get_mut(from..from + (1 << spare))?.fill((length as u8, symbol));
                }
                code += 1;
                place += 1;
            }
            ends[length as usize] = (code, place as i32 - code as i32);
            code <<= 1;
        }
        Some(Self { lookup, ends, symbols: symbols.to_vec() })
    }
}

/// The bits of a scan, highest first.
struct Bits<'a> {
    bytes: &'a [u8],
    /// The next byte not in the buffer; markers are never consumed.
    at: usize,
    buffer: u64,
    count: u32,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 56 {
            let step = match (self.bytes.get(self.at), self.bytes.get(self.at + 1)) {
                (Some(0xff), Some(0x00)) => 2,
                // Any number of fill bytes may precede a marker.
                (Some(0xff), Some(0xff)) => {
                    self.at += 1;
                    continue;
                }
                (Some(0xff) | None, _) => return,
                _ => 1,
            };
            self.buffer = self.buffer << 8 | u64::from(self.bytes[self.at]);
            self.count += 8;
            self.at += step;
        }
    }

    fn take(&mut self, count: u32) -> Result<u32, ScanStop> {
        if self.count < count {
            self.fill();
        }
        self.count = self.count.checked_sub(count).ok_or(ScanStop::Ended)?;
        Ok((self.buffer >> self.count) as u32 & ((1 << count) - 1))
    }

    fn symbol(&mut self, table: Option<&HuffmanTable>) -> Result<u8, ScanStop> {
        let table = table.ok_or(ScanStop::Invalid)?;
        if self.count < 16 {
            self.fill();
        }
        // Missing bits are zeros; a code that needs them is not valid.
        let next = if self.count >= 16 { self.buffer >> (self.count - 16) } else { self.buffer << (16 - self.count) };
        let next = next as u32 & 0xffff;
        let (length, symbol) = table.lookup[(next >> (16 - LOOKUP_BITS)) as usize];
        if length > 0 {
            self.take(length.into())?;
            return Ok(symbol);
        }
        for length in LOOKUP_BITS + 1..=16 {
            let code = next >> (16 - length);
            let (end, to_place) = table.ends[length as usize];
            if code < end {
                self.take(length)?;
                let place = usize::try_from(code as i32 + to_place).map_err(|_| ScanStop::Invalid)?;
                return table.symbols.get(place).copied().ok_or(ScanStop::Invalid);
            }
        }
        Err(if self.count < 16 { ScanStop::Ended } else { ScanStop::Invalid })
    }

    /// T.81, F.2.2.1 and F.2.2.2.
    fn sequential(&mut self, dc: Option<&HuffmanTable>, ac: Option<&HuffmanTable>) -> Result<(), ScanStop> {
        let size = self.symbol(dc)?;
        self.take(u32::from(size & 15))?;
        let mut k = 1;
        while k < 64 {
            let symbol = self.symbol(ac)?;
            match (symbol >> 4, symbol & 15) {
                (15, 0) => k += 16,
                (_, 0) => break,
                (zeros, size) => {
                    k += u32::from(zeros) + 1;
                    self.take(size.into())?;
                }
            }
        }
        Ok(())
    }

    /// T.81, G.1.2. `nonzero` has a bit for each nonzero coefficient; `run` is the number of
    /// further blocks without codes.
    fn progressive(
        &mut self,
        dc: Option<&HuffmanTable>,
        ac: Option<&HuffmanTable>,
        band: SpectralBand,
        nonzero: &mut u64,
        run: &mut u32,
    ) -> Result<(), ScanStop> {
        if band.first == 0 {
            let size = if band.is_refined { 1 } else { self.symbol(dc)? & 15 };
            return self.take(size.into()).map(drop);
        }
        let mut k = band.first;
        while *run == 0 && k <= band.last {
            let symbol = self.symbol(ac)?;
            let mut zeros = u32::from(symbol >> 4);
            let size = u32::from(symbol & 15);
            if size == 0 && zeros < 15 {
                *run = (1 << zeros) + self.take(zeros)?;
                break;
            }
            self.take(if band.is_refined { size.min(1) } else { size })?;
            // Zeros are counted among the coefficients that are 0 so far; the others get one more
            // bit each.
            while k <= band.last {
                if band.is_refined && *nonzero >> k & 1 == 1 {
                    self.take(1)?;
                } else if zeros == 0 {
                    break;
                } else {
                    zeros -= 1;
                }
                k += 1;
            }
            if size > 0 && k <= band.last {
                *nonzero |= 1 << k;
            }
            k += 1;
        }
        if *run > 0 {
            *run -= 1;
            if band.is_refined && k <= band.last {
                let rest = *nonzero >> k << k & (u64::MAX >> (63 - band.last));
                for _ in 0..rest.count_ones() {
                    self.take(1)?;
                }
            }
        }
        Ok(())
    }

    /// Continues after a restart marker.
    fn restart(&mut self) -> Result<(), ScanStop> {
        (self.buffer, self.count) = (0, 0);
        match next_marker(self.bytes, &mut self.at) {
            Some(0xd0..=0xd7) => Ok(()),
            _ => Err(ScanStop::Ended),
        }
    }
}
