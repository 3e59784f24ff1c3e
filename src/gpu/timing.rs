//! GPU timing of the parts of a submission, by timestamp queries.

use super::readback::{Readback, buffer_of};
use super::{Gpu, GpuError};

/// Maximum number of timed passes per submission.
const MAX_TIMED_PASSES: u32 = 1024;

/// Times the passes of a submission.
#[derive(Debug)]
pub struct Timer {
    queries: wgpu::QuerySet,
    /// Part of each pass.
    passes: Vec<&'static str>,
    pub part: &'static str,
}

impl Timer {
    pub fn new(gpu: &Gpu, part: &'static str) -> Self {
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timing"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * MAX_TIMED_PASSES,
        });
        Self { queries, passes: Vec::new(), part }
    }

    /// Timestamp queries for the next pass.
    pub fn next(&mut self) -> Option<Stamps> {
        let pass = u32::try_from(self.passes.len()).ok().filter(|pass| *pass < MAX_TIMED_PASSES)?;
        self.passes.push(self.part);
        Some(Stamps { queries: self.queries.clone(), first: 2 * pass })
    }

    /// Records the readback of the timestamps; `None` without any.
    pub fn end(self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) -> Option<PendingTimes> {
        let count = 2 * self.passes.len() as u32;
        if count == 0 {
            return None;
        }
        let size = 8 * u64::from(count);
        let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timing"),
            size,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        encoder.resolve_query_set(&self.queries, 0..count, &resolved, 0);
        let readback = Readback::of_buffer(encoder, &resolved, buffer_of(gpu, size));
        Some(PendingTimes { passes: self.passes, tick_ns: gpu.queue.get_timestamp_period(), readback })
    }
}

/// Timestamp queries of a pass, begin and end.
#[derive(Debug)]
pub struct Stamps {
    queries: wgpu::QuerySet,
    first: u32,
}

impl Stamps {
    pub fn drawn(&self) -> wgpu::RenderPassTimestampWrites<'_> {
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(self.first),
            end_of_pass_write_index: Some(self.first + 1),
        }
    }

    pub fn computed(&self) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(self.first),
            end_of_pass_write_index: Some(self.first + 1),
        }
    }
}

/// The GPU's time for all passes of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartTime {
    pub part: &'static str,
    pub time_s: f64,
}

/// Pending timings.
#[derive(Debug)]
pub struct PendingTimes {
    passes: Vec<&'static str>,
    /// Timestamp period, nanoseconds.
    tick_ns: f32,
    readback: Readback,
}

impl PendingTimes {
    pub(super) fn submitted(mut self, submission: &wgpu::SubmissionIndex) -> Self {
        self.readback.submitted(submission.clone());
        self
    }

    /// Waits, then returns the time of each part over some submissions, in the order of their first
    /// passes. Passes may overlap on the GPU: the sum may exceed the elapsed time.
    pub fn times(submissions: &[Self], gpu: &Gpu) -> Result<Vec<PartTime>, GpuError> {
        let mut out = Vec::new();
        for timed in submissions {
            let bytes = timed.readback.bytes(gpu)?;
            let ticks: Vec<u64> = bytes.as_chunks().0.iter().map(|tick| u64::from_le_bytes(*tick)).collect();
            sum(&mut out, &timed.passes, &ticks, f64::from(timed.tick_ns));
        }
        Ok(out)
    }
}

/// Each pass has two ticks, begin and end.
fn sum(out: &mut Vec<PartTime>, passes: &[&'static str], ticks: &[u64], tick_ns: f64) {
    for (part, pair) in passes.iter().zip(ticks.chunks_exact(2)) {
        // Passes during which the clock was reset are skipped.
        let time_s = 1e-9 * tick_ns * pair[1].saturating_sub(pair[0]) as f64;
        match out.iter_mut().find(|of| of.part == *part) {
            Some(of) => of.time_s += time_s,
            None => out.push(PartTime { part, time_s }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_times_are_summed_in_the_order_of_first_passes() {
        // 10 ns a tick: 5 and 7 ticks of the first, 30 of the second; the last one's clock was set
        // back.
        let ticks = [100, 105, 105, 135, 200, 207, 9, 4];
        let [draw, blur, grain] = ["objects", "motion_blur", "noise"];
        let mut sums = Vec::new();
        sum(&mut sums, &[draw, blur], &ticks[..4], 10.0);
        sum(&mut sums, &[draw, grain], &ticks[4..], 10.0);
        let expected = [(draw, 120e-9), (blur, 300e-9), (grain, 0.0)];
        assert_eq!(sums.len(), 3);
        for (sum, (part, time_s)) in sums.iter().zip(expected) {
            assert_eq!(sum.part, part);
            assert!((sum.time_s - time_s).abs() < 1e-15, "{sum:?}");
        }
    }
}
