//! Datagrams in, poses in the order of their own clock out. No socket, no clock of its own.

use std::net::SocketAddr;
use std::sync::Arc;

use super::address::{Listen, Protocol};
use super::assemble::{Assembler, Assembly};
use super::buffer::{Buffer, Held, Taken};
use super::error::SampleError;
use super::freed::{self, D1};
use super::lens::LensState;
use super::offset::BEHIND_S;
use super::packet::{Encoding, Packet};
use super::report::{Heard, Report, Source};
use super::sample::Sample;
use super::timing::{Clock, clock};
use super::transforms::pose_of;
use crate::pose::Pose;

/// A source that was not chosen by name gives way to another one after so much silence, seconds.
const SILENT_S: f64 = 2.0;

/// Messages of one datagram were gathered for no longer than this, seconds, ...
const MOST_GATHERED_S: f64 = 0.1;
/// ... and those of the first one for so long: a camera's field at 50 Hz.
const USUAL_INTERVAL_S: f64 = 0.02;

/// Longest name and message that are kept of what others sent, characters.
const MOST_NAME: usize = 200;
const MOST_PROBLEM: usize = 200;

/// A pose of a stream.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracked {
    /// By the sender's clock, plus the delay that was asked for, seconds. Ascends within an epoch.
    pub time_s: f64,
    pub clock: Clock,
    /// By the receiver's clock, seconds.
    pub arrived_s: f64,
    /// The receiver's clock minus the sender's, seconds: 0 where its time is its arrival.
    pub offset_s: f64,
    /// How often the sender's clock, or the sender, had changed.
    pub epoch: u32,
    /// Of the camera: the entrance pupil's.
    pub pose: Pose,
    /// What the stream had said of the lens by then.
    pub lens: Arc<LensState>,
    pub message: Message,
}

/// What came, whole: what is not read here is still there.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Its bytes, which are smaller than the sample that they make.
    OpenTrackIo(Encoding, Vec<u8>),
    FreeD(D1),
}

impl Message {
    /// OpenTrackIO's sample.
    pub fn sample(&self) -> Option<Sample> {
        match self {
            // It was read before.
            Self::OpenTrackIo(encoding, bytes) => Sample::decode(*encoding, bytes).ok(),
            Self::FreeD(_) => None,
        }
    }

    pub fn freed(&self) -> Option<D1> {
        match self {
            Self::OpenTrackIo(..) => None,
            Self::FreeD(message) => Some(*message),
        }
    }
}

/// A pose that waits.
struct Waiting {
    pose: Pose,
    clock: Clock,
    lens: Arc<LensState>,
    message: Message,
}

pub struct Receiver {
    listen: Listen,
    assembler: Assembler,
    buffer: Buffer<Waiting>,
    /// When the followed source was last heard.
    heard_s: f64,
    lens: Arc<LensState>,
    /// Epochs before the buffer was begun anew.
    epochs: u32,
    last_epoch: Option<u32>,
    freed_count: u32,
    /// When the last message of the followed camera came.
    freed_s: Option<f64>,
    report: Report,
}

impl Receiver {
    pub fn new(listen: Listen) -> Self {
        let buffer = Buffer::new(listen.wait_s);
        Self {
            listen,
            assembler: Assembler::default(),
            buffer,
            heard_s: 0.0,
            lens: Arc::default(),
            epochs: 0,
            last_epoch: None,
            freed_count: 0,
            freed_s: None,
            report: Report::default(),
        }
    }

    /// Added to the time of every pose, seconds.
    pub fn delay_s(&self) -> f64 {
        self.listen.delay_s
    }

    pub fn report(&self) -> &Report {
        &self.report
    }

    /// What the stream has said of the lens so far.
    pub fn lens(&self) -> &LensState {
        &self.lens
    }

    /// When a pose that waits for others will be given out at the latest, seconds.
    pub fn due_s(&self) -> Option<f64> {
        self.buffer.due_s()
    }

    /// Takes a datagram, at a time of the receiver's clock, which never goes back, seconds.
    pub fn take(&mut self, bytes: &[u8], from: SocketAddr, now_s: f64) {
        self.report.datagrams += 1;
        self.report.bytes += bytes.len() as u64;
        if self.listen.from.is_some_and(|asked| asked != from.ip()) {
            return self.report.aside(Heard::OtherAddress);
        }
        match self.listen.protocol {
            Protocol::OpenTrackIo => self.take_packet(bytes, from, now_s),
            Protocol::FreeD => self.take_freed(bytes, from, now_s),
        }
    }

    fn take_packet(&mut self, bytes: &[u8], from: SocketAddr, now_s: f64) {
        let packet = match Packet::parse(bytes) {
            Ok(packet) => packet,
            Err(error) => return self.problem(Heard::NoPacket, &error.to_string()),
        };
        let taken = self.assembler.take(from, &packet, now_s);
        self.report.incomplete = self.assembler.given_up;
        let (encoding, payload) = match taken {
            Assembly::Whole(encoding, payload) => (encoding, payload),
            Assembly::Open => return,
            Assembly::Stray => return self.report.aside(Heard::Stray),
        };
        match Sample::decode(encoding, &payload) {
            Ok(sample) => self.take_sample(&sample, Message::OpenTrackIo(encoding, payload), from, now_s),
            Err(error) => self.problem(Heard::NoSample, &error.to_string()),
        }
    }

    fn take_sample(&mut self, sample: &Sample, message: Message, from: SocketAddr, now_s: f64) {
        let source = Source {
            address: from.ip(),
            id: sample.text(&["sourceId"]).map(|id| id.chars().take(MOST_NAME).collect()),
            number: sample.whole(&["sourceNumber"]),
        };
        if !self.follows(&source, from, now_s) {
            return self.report.aside(Heard::OtherSource);
        }
        let mut lens = LensState::clone(&self.lens);
        lens.update(sample);
        if lens != *self.lens {
            self.lens = Arc::new(lens);
        }
        let version = sample.version().map(|version| version.chars().take(MOST_NAME).collect());
        self.report.version = version.or(self.report.version.take());
        let pose = match sample.get(&["transforms"]).map(pose_of) {
            Some(Ok(sensor)) => self.lens.at_pupil(&sensor),
            Some(Err(error)) => return self.problem(Heard::NoPose, &error.to_string()),
            None => return self.report.aside(Heard::NoPose),
        };
        let (time_s, clock) = clock(sample).unwrap_or((now_s, Clock::Arrival));
        let sequence = sample.whole(&["timing", "sequenceNumber"]).and_then(|n| u32::try_from(n).ok());
        let lens = Arc::clone(&self.lens);
        let item = Waiting { pose, clock, lens, message };
        self.hold(Held { time_s, arrived_s: now_s, sequence, item });
    }

    /// A datagram may hold messages of one camera or of several.
    fn take_freed(&mut self, bytes: &[u8], from: SocketAddr, now_s: f64) {
        let (messages, wrong) = freed::messages(bytes);
        let mut followed = Vec::new();
        for message in messages {
            let source = Source { address: from.ip(), id: None, number: Some(message.camera.into()) };
            if self.follows(&source, from, now_s) {
                followed.push(message);
            } else {
                self.report.aside(Heard::OtherSource);
            }
        }
        // Counted once for a datagram.
        match wrong {
            Some(error @ SampleError::FreedType(_)) => self.problem(Heard::NoSample, &error.to_string()),
            Some(error) => self.problem(Heard::NoPacket, &error.to_string()),
            None => {}
        }
        // They were gathered since the last datagram: the last came now, the others evenly before it.
        let gathered_s = self.freed_s.map_or(USUAL_INTERVAL_S, |before_s| now_s - before_s).min(MOST_GATHERED_S);
        let count = followed.len();
        for (before, message) in (0..count).rev().zip(followed) {
            self.hold_freed(message, now_s - gathered_s * before as f64 / count as f64);
        }
        if count > 0 {
            self.freed_s = Some(now_s);
        }
    }

    fn hold_freed(&mut self, message: D1, at_s: f64) {
        // Its clock is our own, so nothing can come before it.
        self.freed_count = self.freed_count.wrapping_add(1);
        let item = Waiting {
            pose: message.pose(),
            clock: Clock::Arrival,
            lens: Arc::clone(&self.lens),
            message: Message::FreeD(message),
        };
        self.hold(Held { time_s: at_s, arrived_s: at_s, sequence: Some(self.freed_count), item });
    }

    /// Whether a source is the one that is wanted: by its name, else the first that is heard, until it falls silent.
    fn follows(&mut self, source: &Source, from: SocketAddr, now_s: f64) -> bool {
        self.report.heard(source);
        if self.listen.source.as_ref().is_some_and(|name| !source.is_called(name)) {
            return false;
        }
        let followed = self.report.followed.as_ref().map(|(followed, _)| followed);
        if followed.is_some_and(|followed| followed != source) {
            if now_s - self.heard_s <= SILENT_S {
                return false;
            }
            self.report.changes += 1;
            // Another source has a clock and a lens of its own.
            self.epochs = self.last_epoch.map_or(0, |epoch| epoch.wrapping_add(1));
            self.buffer = Buffer::new(self.listen.wait_s);
            self.lens = Arc::default();
        }
        self.heard_s = now_s;
        self.report.followed = Some((source.clone(), from));
        true
    }

    fn hold(&mut self, held: Held<Waiting>) {
        match self.buffer.push(held) {
            Taken::Waits => {}
            Taken::Late => self.report.aside(Heard::Late),
            Taken::Repeated => self.report.aside(Heard::Repeated),
            Taken::Odd => self.report.aside(Heard::OddTime),
            Taken::Jumped { by_s, is_repeated } => {
                self.report.jumped(by_s);
                if is_repeated {
                    self.report.aside(Heard::Repeated);
                }
                // The one before it was no odd one, then.
                self.report.aside.entry(Heard::OddTime).and_modify(|number| *number -= 1);
            }
            Taken::Stepped { by_s, odd, behind, late, repeated } => {
                // Where the offset stays, one stamp alone was ahead of the others.
                match by_s.abs() < BEHIND_S {
                    true => self.report.aside(Heard::OddTime),
                    false => self.report.stepped(by_s),
                }
                (0..late).for_each(|_| self.report.aside(Heard::Late));
                (0..repeated).for_each(|_| self.report.aside(Heard::Repeated));
                self.report.aside.entry(Heard::OddTime).and_modify(|number| *number -= odd as u64);
                self.report.aside.entry(Heard::Late).and_modify(|number| *number -= behind as u64);
            }
        }
    }

    /// The next pose, if nothing can come before it any more.
    pub fn next(&mut self, now_s: f64) -> Option<Tracked> {
        self.assembler.give_up(now_s);
        self.report.incomplete = self.assembler.given_up;
        let released = self.buffer.pop(now_s)?;
        let epoch = self.epochs.wrapping_add(released.epoch);
        let offset_s = released.offset_s;
        let Held { time_s, arrived_s, item, .. } = released.held;
        self.report.lost += u64::from(released.lost);
        self.report.gave(time_s, arrived_s, self.last_epoch != Some(epoch));
        self.last_epoch = Some(epoch);
        let Waiting { pose, clock, lens, message } = item;
        let time_s = time_s + self.listen.delay_s;
        Some(Tracked { time_s, clock, arrived_s, offset_s, epoch, pose, lens, message })
    }

    fn problem(&mut self, why: Heard, text: &str) {
        self.report.aside(why);
        self.report.last_problem = Some(text.chars().take(MOST_PROBLEM).collect());
    }
}
