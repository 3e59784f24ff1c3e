//! Turns datagrams into poses in the order of their own clock. No socket and no clock: both are
//! arguments.

use std::net::SocketAddr;
use std::sync::Arc;

use super::address::{ListenOptions, Protocol};
use super::assemble::{Assembler, Assembly};
use super::buffer::{PushOutcome, ReorderBuffer, TimedItem};
use super::error::SampleError;
use super::freed::{self, D1};
use super::lens::LensState;
use super::offset::BEHIND_S;
use super::packet::{Encoding, Packet};
use super::report::{DropReason, Report, Source};
use super::sample::Sample;
use super::timing::{Clock, clock};
use super::transforms::pose_of;
use crate::pose::Pose;

/// Silence after which an unnamed source is replaced by another one, seconds.
const SOURCE_TIMEOUT_S: f64 = 2.0;

/// Longest time over which the messages of one datagram were collected, seconds.
const MAX_COLLECTION_S: f64 = 0.1;
/// Collection time of the first datagram, seconds: a field of a camera at 50 Hz.
const DEFAULT_INTERVAL_S: f64 = 0.02;

/// Longest kept name and error message from the network, characters.
const MAX_NAME_CHARS: usize = 200;
const MAX_PROBLEM_CHARS: usize = 200;

/// A pose of a stream.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamPose {
    /// Time by the sender's clock plus the requested delay, seconds. Ascends within an epoch.
    pub time_s: f64,
    pub clock: Clock,
    /// Arrival by the receiver's clock, seconds.
    pub arrived_s: f64,
    /// The receiver's clock minus the sender's, seconds: 0 if the time is that of the arrival.
    pub offset_s: f64,
    /// Number of changes of the sender's clock or of the sender.
    pub epoch: u32,
    /// The camera's pose, at the entrance pupil.
    pub pose: Pose,
    /// The stream's lens data at that time.
    pub lens: Arc<LensState>,
    pub message: Message,
}

/// The complete message, including data that are not interpreted.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// The encoded bytes, which are smaller than the decoded sample.
    OpenTrackIo(Encoding, Vec<u8>),
    FreeD(D1),
}

impl Message {
    /// The decoded OpenTrackIO sample.
    pub fn sample(&self) -> Option<Sample> {
        match self {
            // Decoded without error before.
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

/// A pose in the reorder buffer.
struct PendingPose {
    pose: Pose,
    clock: Clock,
    lens: Arc<LensState>,
    message: Message,
}

/// State of a receiver: it follows one source, and starts anew if that one restarts.
pub struct Receiver {
    listen: ListenOptions,
    assembler: Assembler,
    buffer: ReorderBuffer<PendingPose>,
    /// Arrival of the last datagram of the followed source.
    last_received_s: f64,
    lens: Arc<LensState>,
    /// Number of epochs before the buffer was restarted.
    epochs: u32,
    last_epoch: Option<u32>,
    freed_count: u32,
    /// Arrival of the followed camera's last message.
    last_freed_s: Option<f64>,
    report: Report,
}

impl Receiver {
    pub fn new(listen: ListenOptions) -> Self {
        let buffer = ReorderBuffer::new(listen.wait_s);
        Self {
            listen,
            assembler: Assembler::default(),
            buffer,
            last_received_s: 0.0,
            lens: Arc::default(),
            epochs: 0,
            last_epoch: None,
            freed_count: 0,
            last_freed_s: None,
            report: Report::default(),
        }
    }

    /// The requested delay, added to the time of every pose, seconds.
    pub fn delay_s(&self) -> f64 {
        self.listen.delay_s
    }

    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Lens data received so far.
    pub fn lens(&self) -> &LensState {
        &self.lens
    }

    /// Latest release time of a waiting pose, seconds.
    pub fn due_s(&self) -> Option<f64> {
        self.buffer.due_s()
    }

    /// Processes a datagram. `now_s` is the receiver's clock, which never goes back, seconds.
    pub fn take(&mut self, bytes: &[u8], from: SocketAddr, now_s: f64) {
        self.report.datagrams += 1;
        self.report.bytes += bytes.len() as u64;
        if self.listen.from.is_some_and(|address| address != from.ip()) {
            return self.report.count_drop(DropReason::OtherAddress);
        }
        match self.listen.protocol {
            Protocol::OpenTrackIo => self.take_packet(bytes, from, now_s),
            Protocol::FreeD => self.take_freed(bytes, from, now_s),
        }
    }

    fn take_packet(&mut self, bytes: &[u8], from: SocketAddr, now_s: f64) {
        let packet = match Packet::parse(bytes) {
            Ok(packet) => packet,
            Err(error) => return self.problem(DropReason::NoPacket, &error.to_string()),
        };
        let taken = self.assembler.take(from, &packet, now_s);
        self.report.incomplete = self.assembler.abandoned;
        let (encoding, payload) = match taken {
            Assembly::Whole(encoding, payload) => (encoding, payload),
            Assembly::Open => return,
            Assembly::Stray => return self.report.count_drop(DropReason::Stray),
        };
        match Sample::decode(encoding, &payload) {
            Ok(sample) => self.take_sample(&sample, Message::OpenTrackIo(encoding, payload), from, now_s),
            Err(error) => self.problem(DropReason::NoSample, &error.to_string()),
        }
    }

    fn take_sample(&mut self, sample: &Sample, message: Message, from: SocketAddr, now_s: f64) {
        let source = Source {
            address: from.ip(),
            id: sample.text(&["sourceId"]).map(|id| id.chars().take(MAX_NAME_CHARS).collect()),
            number: sample.unsigned(&["sourceNumber"]),
        };
        if !self.follows(&source, from, now_s) {
            return self.report.count_drop(DropReason::OtherSource);
        }
        let mut lens = LensState::clone(&self.lens);
        lens.update(sample);
        if lens != *self.lens {
            self.lens = Arc::new(lens);
        }
        let version = sample.version().map(|version| version.chars().take(MAX_NAME_CHARS).collect());
        self.report.version = version.or(self.report.version.take());
        let pose = match sample.get(&["transforms"]).map(pose_of) {
            Some(Ok(sensor)) => self.lens.at_pupil(&sensor),
            Some(Err(error)) => return self.problem(DropReason::NoPose, &error.to_string()),
            None => return self.report.count_drop(DropReason::NoPose),
        };
        let (time_s, clock) = clock(sample).unwrap_or((now_s, Clock::Arrival));
        let sequence = sample.unsigned(&["timing", "sequenceNumber"]).and_then(|n| u32::try_from(n).ok());
        let lens = Arc::clone(&self.lens);
        let item = PendingPose { pose, clock, lens, message };
        self.hold(TimedItem { time_s, arrived_s: now_s, sequence, item });
    }

    /// A datagram may contain messages of one camera or of several.
    fn take_freed(&mut self, bytes: &[u8], from: SocketAddr, now_s: f64) {
        let (messages, wrong) = freed::messages(bytes);
        let mut followed = Vec::new();
        for message in messages {
            let source = Source { address: from.ip(), id: None, number: Some(message.camera.into()) };
            if self.follows(&source, from, now_s) {
                followed.push(message);
            } else {
                self.report.count_drop(DropReason::OtherSource);
            }
        }
        // Counted once per datagram.
        match wrong {
            Some(error @ SampleError::FreedType(_)) => self.problem(DropReason::NoSample, &error.to_string()),
            Some(error) => self.problem(DropReason::NoPacket, &error.to_string()),
            None => {}
        }
        // They were collected since the last datagram: the last one is stamped now, the others
        // evenly before it.
        let collected_s =
            self.last_freed_s.map_or(DEFAULT_INTERVAL_S, |before_s| now_s - before_s).min(MAX_COLLECTION_S);
        let count = followed.len();
        for (before, message) in (0..count).rev().zip(followed) {
            self.hold_freed(message, now_s - collected_s * before as f64 / count as f64);
        }
        if count > 0 {
            self.last_freed_s = Some(now_s);
        }
    }

    fn hold_freed(&mut self, message: D1, at_s: f64) {
        // Stamped on arrival, so nothing earlier can follow.
        self.freed_count = self.freed_count.wrapping_add(1);
        let item = PendingPose {
            pose: message.pose(),
            clock: Clock::Arrival,
            lens: Arc::clone(&self.lens),
            message: Message::FreeD(message),
        };
        self.hold(TimedItem { time_s: at_s, arrived_s: at_s, sequence: Some(self.freed_count), item });
    }

    /// True if a source is accepted: the one with the requested name, or the first one received
    /// until it falls silent.
    fn follows(&mut self, source: &Source, from: SocketAddr, now_s: f64) -> bool {
        self.report.count_source(source);
        if self.listen.source.as_ref().is_some_and(|name| !source.matches_name(name)) {
            return false;
        }
        let followed = self.report.followed.as_ref().map(|(followed, _)| followed);
        if followed.is_some_and(|followed| followed != source) {
            if now_s - self.last_received_s <= SOURCE_TIMEOUT_S {
                return false;
            }
            self.report.changes += 1;
            // Another source has a clock and lens of its own.
            self.epochs = self.last_epoch.map_or(0, |epoch| epoch.wrapping_add(1));
            self.buffer = ReorderBuffer::new(self.listen.wait_s);
            self.lens = Arc::default();
        }
        self.last_received_s = now_s;
        self.report.followed = Some((source.clone(), from));
        true
    }

    fn hold(&mut self, pose: TimedItem<PendingPose>) {
        match self.buffer.push(pose) {
            PushOutcome::Waits => {}
            PushOutcome::Late => self.report.count_drop(DropReason::Late),
            PushOutcome::Repeated => self.report.count_drop(DropReason::Repeated),
            PushOutcome::Odd => self.report.count_drop(DropReason::OddTime),
            PushOutcome::Jumped { by_s, is_repeated } => {
                self.report.count_jump(by_s);
                if is_repeated {
                    self.report.count_drop(DropReason::Repeated);
                }
                // The previous one was not odd after all.
                self.report.dropped.entry(DropReason::OddTime).and_modify(|number| *number -= 1);
            }
            PushOutcome::Stepped { by_s, odd, behind, late, repeated } => {
                // If the offset stays, a single stamp was ahead of the others.
                match by_s.abs() < BEHIND_S {
                    true => self.report.count_drop(DropReason::OddTime),
                    false => self.report.count_step(by_s),
                }
                (0..late).for_each(|_| self.report.count_drop(DropReason::Late));
                (0..repeated).for_each(|_| self.report.count_drop(DropReason::Repeated));
                self.report.dropped.entry(DropReason::OddTime).and_modify(|number| *number -= odd as u64);
                self.report.dropped.entry(DropReason::Late).and_modify(|number| *number -= behind as u64);
            }
        }
    }

    /// The next pose, once no earlier one can arrive.
    pub fn next(&mut self, now_s: f64) -> Option<StreamPose> {
        self.assembler.abandon_old(now_s);
        self.report.incomplete = self.assembler.abandoned;
        let released = self.buffer.pop(now_s)?;
        let epoch = self.epochs.wrapping_add(released.epoch);
        let offset_s = released.offset_s;
        let TimedItem { time_s, arrived_s, item, .. } = released.timed;
        self.report.missed += u64::from(released.missed);
        self.report.count_pose(time_s, arrived_s, self.last_epoch != Some(epoch));
        self.last_epoch = Some(epoch);
        let PendingPose { pose, clock, lens, message } = item;
        let time_s = time_s + self.listen.delay_s;
        Some(StreamPose { time_s, clock, arrived_s, offset_s, epoch, pose, lens, message })
    }

    fn problem(&mut self, why: DropReason, text: &str) {
        self.report.count_drop(why);
        self.report.last_problem = Some(text.chars().take(MAX_PROBLEM_CHARS).collect());
    }
}
