//! `locard inspect` of a stream.

use std::io::Write;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use glam::DVec3;

use super::pick::triple;
use super::print_status;
use locard_engine::stream::{Clock, LensState, Poses, Report, StreamPose};
use locard_engine::text::{count, fixed, shown};

/// Timeout of the first datagram, s.
const FIRST_DATAGRAM_TIMEOUT_S: f64 = 10.0;

/// Listens for a number of seconds from the first pose on, and prints a report.
pub fn run(url: &str, seconds: f64) -> Result<()> {
    let mut poses = Poses::open(url)?;
    print_status(false, &format!("listening at {}", poses.address()));
    let began = Instant::now();
    let mut last = poses.next(began + Duration::from_secs_f64(FIRST_DATAGRAM_TIMEOUT_S.max(seconds)))?;
    let from_first = Instant::now();
    if last.is_some() {
        let until = from_first + Duration::from_secs_f64(seconds);
        while let Some(tracked) = poses.next(until)? {
            last = Some(tracked);
            if Instant::now() >= until {
                break;
            }
        }
    }
    let report = poses.report();
    if report.datagrams == 0 {
        let waited = fixed(began.elapsed().as_secs_f64(), 0);
        bail!(
            "{}: nothing arrived at {} in {waited} s; check that the sender uses this address and port, and that no \
             firewall is in between ({})",
            shown(url),
            poses.address(),
            if poses.address().ip().is_loopback() { "only this machine can send to this address" } else { "UDP" }
        );
    }
    let mut out = std::io::stdout().lock();
    let listened_s = if last.is_some() { from_first } else { began }.elapsed().as_secs_f64();
    writeln!(out, "stream     {}, received for {} s", shown(url), fixed(listened_s, 1))?;
    sources(&mut out, report)?;
    if let Some(tracked) = &last {
        place(&mut out, report, tracked)?;
    }
    writeln!(out, "lens       {}", lens(poses.lens(), last.as_ref()))?;
    drops(&mut out, report)
}

fn sources(out: &mut impl Write, report: &Report) -> Result<()> {
    if let Some((source, from)) = &report.followed {
        let version = report.version.as_ref().map(|v| format!(", OpenTrackIO {}", shown(v))).unwrap_or_default();
        writeln!(out, "source     {source} port {}{version}", from.port())?;
    }
    let followed = report.followed.as_ref().map(|(followed, _)| followed);
    for (other, number) in report.sources.iter().filter(|(source, _)| Some(source) != followed) {
        writeln!(out, "beside it  {other}: {}", count(*number as usize, "sample"))?;
    }
    Ok(())
}

fn place(out: &mut impl Write, report: &Report, tracked: &StreamPose) -> Result<()> {
    let rate = report.interval_s.filter(|interval_s| *interval_s > 0.0).map(|interval_s| 1.0 / interval_s);
    let rate = rate.map(|hz| format!(", {} a second, uneven by {} ms", fixed(hz, 2), fixed(1e3 * report.jitter_s, 2)));
    writeln!(out, "poses      {}{}", report.poses, rate.unwrap_or_default())?;
    let at = match tracked.clock {
        Clock::Arrival => String::new(),
        _ => format!(", the last at {} s", fixed(tracked.time_s, 6)),
    };
    writeln!(out, "clock      {}{at}", tracked.clock)?;
    let forward = tracked.pose.world_from_camera_rotation() * DVec3::Z;
    let [x, y, z] = forward.to_array().map(|v| fixed(v, 3));
    let at = triple(tracked.pose.position_in_world_m());
    writeln!(out, "camera at  {at} m, looks along {x} {y} {z}")?;
    if let Some(message) = tracked.message.freed() {
        writeln!(out, "encoders   zoom {}, focus {}, spare {}", message.zoom, message.focus, message.spare)?;
    }
    Ok(())
}

fn lens(lens: &LensState, last: Option<&StreamPose>) -> String {
    if last.is_some_and(|tracked| tracked.message.freed().is_some()) {
        return "FreeD transmits only its encoders".to_owned();
    }
    let camera = lens.sensor_px.map(|[width, height]| lens.geometry(width, height));
    match camera {
        Some(Ok((_, off_px))) if off_px > 0.01 => {
            format!("{lens}; as OpenCV's model it is up to {} px off", fixed(off_px, 2))
        }
        Some(Err(error)) => format!("{lens}; {error}"),
        _ => lens.to_string(),
    }
}

fn drops(out: &mut impl Write, report: &Report) -> Result<()> {
    writeln!(out, "drops      {}", report.drops())?;
    if report.jumps + report.steps > 0 {
        let times = count((report.jumps + report.steps) as usize, "time");
        writeln!(out, "odd        its clock was reset {times}, the last by {} s", fixed(report.last_step_s, 3))?;
    }
    if report.changes > 0 {
        writeln!(out, "odd        another source took over {}", count(report.changes as usize, "time"))?;
    }
    if let Some(problem) = &report.last_problem {
        writeln!(out, "odd        the last that was unreadable: {}", shown(problem))?;
    }
    Ok(())
}
