//! FreeD's message D1: the pose of a camera in 29 bytes.
//!
//! | bytes | content, most significant byte first |
//! |---|---|
//! | 0 | `D1` |
//! | 1 | the camera's number |
//! | 2 to 10 | pan, tilt, roll: signed, 24 bits each, 1/32768 degree |
//! | 11 to 19 | x, y, height: signed, 24 bits each, 1/64 mm |
//! | 20 to 25 | zoom, focus: unsigned, 24 bits each, in units of the lens's own |
//! | 26, 27 | spare |
//! | 28 | checksum: hexadecimal 40 minus all bytes before it, modulo 256 |
//!
//! 24 bits with their sign are ±2²³: ±256° at 2¹⁵ parts a degree, ±131.072 m at 2⁶ parts a
//! millimetre.
//!
//! z is up. At pan 0 the camera points along y. A positive pan rotates it to the right, a positive
//! tilt upwards, and a positive roll clockwise as seen from behind. Axes and order of rotation are
//! those of OpenTrackIO ([`Angles`]); only pan has the opposite sign.
//!
//! After the free-d installation manual (Vinten Radamec, V1.4.4), appendices A.3.11 and B.

use glam::DVec3;

use super::error::SampleError;
use super::transforms::Angles;
use crate::pose::Pose;

pub const LENGTH: usize = 29;
const TYPE: u8 = 0xD1;
const ANGLE_PER_DEG: f64 = 32768.0;
const LENGTH_PER_M: f64 = 64.0 * 1000.0;

/// The fields of the message as transmitted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct D1 {
    pub camera: u8,
    /// 1/32768 degree; signed, 24 bits.
    pub pan: i32,
    pub tilt: i32,
    pub roll: i32,
    /// 1/64 mm; signed, 24 bits.
    pub x: i32,
    pub y: i32,
    pub height: i32,
    /// 24 bits, in units of the lens.
    pub zoom: u32,
    pub focus: u32,
    pub spare: u16,
}

impl D1 {
    pub fn parse(bytes: &[u8]) -> Result<Self, SampleError> {
        let bytes: &[u8; LENGTH] = bytes.try_into().map_err(|_| SampleError::FreedLength(bytes.len()))?;
        if bytes[0] != TYPE {
            return Err(SampleError::FreedType(bytes[0]));
        }
        if checksum(&bytes[..28]) != bytes[28] {
            return Err(SampleError::FreedChecksum);
        }
        let unsigned = |at: usize| u32::from_be_bytes([0, bytes[at], bytes[at + 1], bytes[at + 2]]);
        // The arithmetic shift extends the sign.
        let signed = |at: usize| i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8;
        Ok(Self {
            camera: bytes[1],
            pan: signed(2),
            tilt: signed(5),
            roll: signed(8),
            x: signed(11),
            y: signed(14),
            height: signed(17),
            zoom: unsigned(20),
            focus: unsigned(23),
            spare: u16::from_be_bytes([bytes[26], bytes[27]]),
        })
    }

    /// Serializes the message. The lower 24 bits of each number are used.
    pub fn bytes(&self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        (bytes[0], bytes[1]) = (TYPE, self.camera);
        let signed = [self.pan, self.tilt, self.roll, self.x, self.y, self.height];
        let numbers = signed.map(i32::cast_unsigned).into_iter().chain([self.zoom, self.focus]);
        for (to, number) in bytes[2..26].chunks_exact_mut(3).zip(numbers) {
            to.copy_from_slice(&number.to_be_bytes()[1..]);
        }
        bytes[26..28].copy_from_slice(&self.spare.to_be_bytes());
        bytes[28] = checksum(&bytes[..28]);
        bytes
    }

    pub fn pose(&self) -> Pose {
        let deg = |number: i32| f64::from(number) / ANGLE_PER_DEG;
        let angles = Angles { pan_deg: -deg(self.pan), tilt_deg: deg(self.tilt), roll_deg: deg(self.roll) };
        angles.pose(DVec3::new(self.x.into(), self.y.into(), self.height.into()) / LENGTH_PER_M)
    }

    /// Quantizes a pose: the error is at most half a unit, 7.8 µm and 0.055″. Zoom, focus and spare
    /// are 0.
    pub fn of_pose(camera: u8, pose: &Pose) -> Result<Self, SampleError> {
        let at = pose.position_in_world_m();
        let length = |what, value_m: f64| {
            let number = (value_m * LENGTH_PER_M).round();
            let max = f64::from((1 << 23) - 1);
            if !(-max..=max).contains(&number) {
                let value = format!("{} m", crate::text::short(value_m));
                return Err(SampleError::FreedRange { what, value, max: "131.07 m" });
            }
            Ok(number as i32)
        };
        let Angles { pan_deg, tilt_deg, roll_deg } = Angles::of(pose);
        let [pan, tilt, roll] = [-pan_deg, tilt_deg, roll_deg].map(|deg| (deg * ANGLE_PER_DEG).round() as i32);
        let (x, y, height) = (length("x", at.x)?, length("y", at.y)?, length("height", at.z)?);
        Ok(Self { camera, pan, tilt, roll, x, y, height, zoom: 0, focus: 0, spare: 0 })
    }
}

/// The messages of a datagram, and the error of the first bytes that are not a message. Bridges
/// from serial lines put several messages into a datagram, and pad them.
pub fn messages(bytes: &[u8]) -> (Vec<D1>, Option<SampleError>) {
    let (mut messages, mut wrong, mut rest) = (Vec::new(), None, bytes);
    let parse = |rest: &[u8]| D1::parse(&rest[..rest.len().min(LENGTH)]);
    while !rest.is_empty() {
        if let Ok(message) = parse(rest) {
            messages.push(message);
            rest = &rest[LENGTH..];
            continue;
        }
        let next = (1..rest.len()).find(|at| parse(&rest[*at..]).is_ok()).unwrap_or(rest.len());
        if !is_padding(&rest[..next]) {
            wrong = wrong.or(parse(&rest[..next]).err());
        }
        rest = &rest[next..];
    }
    let nothing = messages.is_empty().then_some(SampleError::FreedLength(bytes.len()));
    (messages, wrong.or(nothing))
}

/// Zeros, ones, or line ends.
fn is_padding(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| matches!(byte, 0 | 0xFF | b'\r' | b'\n'))
}

fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0x40, |sum, byte| sum.wrapping_sub(*byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Camera 1, pan 90° right: 90 · 32768 = 2949120 = 2D0000. Tilt −1.5°: −49152 = FF4000. Roll
    /// 180°: 5898240 = 5A0000. x 1 m: 64000 = 00FA00. y −0.25 mm: −16 = FFFFF0. Height 1.5 m: 96000
    /// = 017700. Zoom 0x000400, focus 0xFFFFFF, spare 0x1234.
    const BYTES: [u8; LENGTH] = [
        0xD1, 0x01, 0x2D, 0x00, 0x00, 0xFF, 0x40, 0x00, 0x5A, 0x00, 0x00, 0x00, 0xFA, 0x00, 0xFF, 0xFF, 0xF0, 0x01,
        0x77, 0x00, 0x00, 0x04, 0x00, 0xFF, 0xFF, 0xFF, 0x12, 0x34, CHECKSUM,
    ];
    /// D1 + 01 + 2D = FF; + FF + 40 = 23E; + 5A = 298; + FA = 392; + FF + FF + F0 = 680; + 01 + 77
    /// = 6F8; + 04 = 6FC; + 3·FF = 9F9; + 12 + 34 = A3F. 40 − A3F = −9FF, modulo 100: 01.
    const CHECKSUM: u8 = 0x01;

    #[test]
    fn message_matches_computed_bytes() {
        let message = D1::parse(&BYTES).unwrap();
        let expected = D1 {
            camera: 1,
            pan: 2_949_120,
            tilt: -49_152,
            roll: 5_898_240,
            x: 64_000,
            y: -16,
            height: 96_000,
            zoom: 0x400,
            focus: 0xFF_FFFF,
            spare: 0x1234,
        };
        assert_eq!(message, expected);
        assert_eq!(message.bytes(), BYTES);
        let pose = message.pose();
        assert!((pose.position_in_world_m() - DVec3::new(1.0, -0.000_25, 1.5)).length() < 1e-12);
        // To the right, along x, and a little down; upside down.
        let (s, c) = 1.5f64.to_radians().sin_cos();
        let turn = pose.world_from_camera_rotation();
        assert!((turn * DVec3::Z - DVec3::new(c, 0.0, -s)).length() < 1e-12, "{}", turn * DVec3::Z);
        assert!((turn * DVec3::X - DVec3::new(0.0, 1.0, 0.0)).length() < 1e-12, "{}", turn * DVec3::X);
    }

    #[test]
    fn padding_between_and_after_messages_is_accepted() {
        for padding in [&[0; 3][..], &[0xFF; 35], b"\r\n"] {
            let (decoded, wrong) = messages(&[&BYTES[..], padding, &BYTES, padding].concat());
            assert_eq!((decoded.len(), wrong), (2, None), "{padding:?}");
        }
        let mut damaged = BYTES;
        damaged[5] ^= 1;
        let (decoded, wrong) = messages(&[&BYTES[..], &damaged, &BYTES].concat());
        assert_eq!((decoded.len(), wrong), (2, Some(SampleError::FreedChecksum)));
        let (decoded, wrong) = messages(&[&BYTES[..], b"rest"].concat());
        assert_eq!((decoded.len(), wrong), (1, Some(SampleError::FreedLength(4))));
        for none in [&b""[..], &[0; 29]] {
            assert_eq!(messages(none), (Vec::new(), Some(SampleError::FreedLength(none.len()))));
        }
    }

    #[test]
    fn malformed_messages_are_refused() {
        assert_eq!(D1::parse(&BYTES[..28]), Err(SampleError::FreedLength(28)));
        assert_eq!(D1::parse(&[]), Err(SampleError::FreedLength(0)));
        for at in 0..LENGTH {
            let mut damaged = BYTES;
            damaged[at] ^= 1;
            let expected = if at == 0 { SampleError::FreedType(0xD0) } else { SampleError::FreedChecksum };
            assert_eq!(D1::parse(&damaged), Err(expected), "byte {at}");
        }
        for far in [131.073, -131.073, f64::NAN, f64::INFINITY] {
            let pose = Pose { translation_m: DVec3::new(far, 0.0, 0.0), ..Pose::IDENTITY };
            let error = D1::of_pose(1, &pose).unwrap_err().to_string();
            assert!(error.contains("131.07 m"), "{error}");
        }
    }

    proptest! {
        #[test]
        fn any_message_round_trips(mut bytes in prop::array::uniform29(any::<u8>())) {
            bytes[0] = TYPE;
            bytes[28] = checksum(&bytes[..28]);
            prop_assert_eq!(D1::parse(&bytes).unwrap().bytes(), bytes);
        }

        #[test]
        fn pose_round_trips_to_half_a_unit(
            at in prop::array::uniform3(-131.0f64..131.0), pan in -179.0f64..179.0, tilt in -85.0f64..85.0, roll in -179.0f64..179.0
        ) {
            let sent = Angles { pan_deg: pan, tilt_deg: tilt, roll_deg: roll }.pose(at.into());
            let back = D1::of_pose(9, &sent).unwrap().pose();
            let off_m = (back.position_in_world_m() - sent.position_in_world_m()).abs().max_element();
            // Half of 1/64 mm; three times half of 1/32768 degree is 8e-7 rad.
            prop_assert!(off_m <= 0.5 / LENGTH_PER_M + 1e-12, "{off_m}");
            let off_rad = back.rotation.angle_between(sent.rotation);
            prop_assert!(off_rad < 1e-6, "{off_rad}");
        }
    }
}
