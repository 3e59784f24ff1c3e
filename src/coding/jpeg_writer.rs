//! Writes baseline JPEG files with given quantised coefficients, for tests. Source: ITU-T T.81
//! (markers: annex B; Huffman coding: annex F.1.2; tables: annex K.3, luminance's for all planes).

use super::dct::{BLOCK_LEN, ZIGZAG};

/// Code and length of each symbol.
struct Codes(Vec<Option<(u32, u32)>>);

impl Codes {
    /// T.81, annex C.2.
    fn new(lengths: &[u8; 16], symbols: &[u8]) -> Self {
        let mut codes = vec![None; 256];
        let (mut code, mut rest) = (0, symbols.iter());
        for (length, &count) in (1..).zip(lengths) {
            for &symbol in rest.by_ref().take(count.into()) {
                codes[usize::from(symbol)] = Some((code, length));
                code += 1;
            }
            code <<= 1;
        }
        Self(codes)
    }
}

const DC_LENGTHS: [u8; 16] = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
const AC_LENGTHS: [u8; 16] = [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 125];
/// Symbols of table K.5 with codes of at most 15 bits. Those of 16 bits ascend.
const SHORT_AC_SYMBOLS: [u8; 37] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71, 0x14,
    0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72, 0x82,
];

fn ac_symbols() -> Vec<u8> {
    let all = (0..16).flat_map(|run| (1..=10).map(move |size| run << 4 | size));
    SHORT_AC_SYMBOLS.into_iter().chain(all.filter(|symbol| !SHORT_AC_SYMBOLS.contains(symbol))).collect()
}

#[derive(Default)]
struct BitWriter {
    bytes: Vec<u8>,
    buffer: u64,
    count: u32,
}

impl BitWriter {
    fn put(&mut self, value: u32, count: u32) {
        self.buffer = self.buffer << count | u64::from(value);
        self.count += count;
        while self.count >= 8 {
            self.count -= 8;
            let byte = (self.buffer >> self.count) as u8;
            self.bytes.push(byte);
            if byte == 0xff {
                self.bytes.push(0);
            }
        }
    }

    fn symbol(&mut self, codes: &Codes, symbol: u8) {
        let (code, length) = codes.0[usize::from(symbol)].unwrap();
        self.put(code, length);
    }

    /// The bits of a value of `size` bits; negative values are one lower (T.81, F.1.2.1).
    fn magnitude(&mut self, value: i32, size: u32) {
        let bits = if value < 0 { value - 1 } else { value };
        self.put(bits as u32 & ((1 << size) - 1), size);
    }
}

fn size_of(value: i32) -> u32 {
    32 - value.unsigned_abs().leading_zeros()
}

fn segment(file: &mut Vec<u8>, marker: u8, content: &[u8]) {
    file.extend([0xff, marker]);
    file.extend((content.len() as u16 + 2).to_be_bytes());
    file.extend(content);
}

/// A file's planes. AC coefficients have at most 10 bits, and differences of DC at most 11.
pub struct JpegPlanes<'a> {
    pub size: [u16; 2],
    /// Luma samples for each chroma sample.
    pub factor: [u8; 2],
    /// Quantisation steps of each plane.
    pub steps: &'a [[u16; BLOCK_LEN]],
    /// Multiples of the steps, block by block in rows; whole coded units.
    pub blocks: &'a [Vec<[i32; BLOCK_LEN]>],
    /// Colour transform of an Adobe segment; none without.
    pub adobe: Option<u8>,
}

impl JpegPlanes<'_> {
    pub fn file(&self) -> Vec<u8> {
        let mut file = vec![0xff, 0xd8];
        if let Some(transform) = self.adobe {
            segment(&mut file, 0xee, &[b"Adobe".as_slice(), &[0, 100, 0, 0, 0, 0, transform]].concat());
        }
        for (i, steps) in self.steps.iter().enumerate() {
            let values = ZIGZAG.iter().flat_map(|&at| steps[at].to_be_bytes());
            segment(&mut file, 0xdb, &[vec![0x10 | i as u8], values.collect()].concat());
        }
        let count = self.blocks.len() as u8;
        let mut frame = vec![8];
        frame.extend(self.size[1].to_be_bytes());
        frame.extend(self.size[0].to_be_bytes());
        frame.push(count);
        let sampling = |plane: usize| if plane == 0 { self.factor } else { [1, 1] };
        for plane in 0..count {
            let [h, v] = sampling(plane.into());
            frame.extend([plane + 1, h << 4 | v, plane]);
        }
        segment(&mut file, 0xc0, &frame);
        let dc_symbols: Vec<u8> = (0..12).collect();
        segment(&mut file, 0xc4, &[&[0x00], DC_LENGTHS.as_slice(), &dc_symbols].concat());
        segment(&mut file, 0xc4, &[&[0x10], AC_LENGTHS.as_slice(), &ac_symbols()].concat());
        let mut scan = vec![count];
        scan.extend((0..count).flat_map(|plane| [plane + 1, 0]));
        segment(&mut file, 0xda, &[scan, vec![0, 63, 0]].concat());
        file.extend(self.scan(&Codes::new(&DC_LENGTHS, &dc_symbols)));
        file.extend([0xff, 0xd9]);
        file
    }

    fn scan(&self, dc: &Codes) -> Vec<u8> {
        let ac = Codes::new(&AC_LENGTHS, &ac_symbols());
        let units = [0, 1].map(|i| usize::from(self.size[i]).div_ceil(8 * usize::from(self.factor[i])));
        let mut bits = BitWriter::default();
        let mut before = vec![0; self.blocks.len()];
        for unit in 0..units[0] * units[1] {
            for (plane, blocks) in self.blocks.iter().enumerate() {
                let [h, v] = if plane == 0 { self.factor.map(usize::from) } else { [1, 1] };
                for part in 0..h * v {
                    let at = [unit % units[0] * h + part % h, unit / units[0] * v + part / h];
                    let block = blocks[at[1] * units[0] * h + at[0]];
                    let difference = block[0] - std::mem::replace(&mut before[plane], block[0]);
                    bits.symbol(dc, size_of(difference) as u8);
                    bits.magnitude(difference, size_of(difference));
                    let mut zeros = 0;
                    for value in ZIGZAG[1..].iter().map(|&i| block[i]) {
                        if value == 0 {
                            zeros += 1;
                            continue;
                        }
                        for _ in 0..zeros / 16 {
                            bits.symbol(&ac, 0xf0);
                        }
                        bits.symbol(&ac, (zeros % 16) << 4 | size_of(value) as u8);
                        bits.magnitude(value, size_of(value));
                        zeros = 0;
                    }
                    if zeros > 0 {
                        bits.symbol(&ac, 0);
                    }
                }
            }
        }
        bits.put(0x7f, 7);
        bits.bytes
    }
}
