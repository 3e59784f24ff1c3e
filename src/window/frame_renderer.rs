//! Renders pictures on background threads, so that the window never blocks. One thread decodes,
//! plans and records; another waits for the GPU. Up to two pictures are in flight: one is drawn
//! while the next is recorded.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use super::reader::Reader;
use super::scene_compositor::SceneCompositor;
use super::task::BackgroundTask;
use locard_engine::compositor::{Compositor, FrameStats, Pending, Target};
use locard_engine::frame::Frame;
use locard_engine::gpu::{Gpu, GpuError, PartTime, read_back};
use locard_engine::memo::{ByAddress, Memo};
use locard_engine::pixels::Pixels;
use locard_engine::shot::{ReducedFrame, Shot, ShotError};

/// Contains code values, as the window expects of a texture.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Identifies a rendered picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderKey {
    pub frame: usize,
    /// [`Project::version`](super::Project::version), or the version of the variant.
    pub version: u64,
    /// Renders the A/B comparison variant.
    pub is_variant: bool,
    /// Reduction factor of the size; 1 for full size.
    pub reduction: u32,
    /// Requested: shadows and real edges may be approximate. Rendered: they are.
    pub is_approximate: bool,
}

impl RenderKey {
    /// True if both have the same content, regardless of size and quality.
    pub fn has_content_of(&self, other: &Self) -> bool {
        let at_full_quality = |key: &Self| Self { reduction: 1, is_approximate: false, ..*key };
        at_full_quality(self) == at_full_quality(other)
    }

    /// True if size or quality is reduced.
    pub fn is_reduced(&self) -> bool {
        self.reduction > 1 || self.is_approximate
    }
}

/// A picture to render.
#[derive(Debug)]
pub struct RenderRequest {
    pub key: RenderKey,
    /// Snapshot of all settings.
    pub shot: Shot,
    /// A frame of a live camera. If `None`, the recording's frame is decoded.
    pub live_frame: Option<Arc<Frame>>,
    /// Destination, of the picture's size.
    pub texture: wgpu::Texture,
    pub outputs: RenderOutputs,
}

/// Additional outputs of a render.
#[derive(Clone, Copy, Debug, Default)]
pub struct RenderOutputs {
    /// The code values.
    pub codes: bool,
    /// GPU time of each part.
    pub times: bool,
}

/// A rendered picture or an error.
#[derive(Debug)]
pub struct RenderResult {
    pub key: RenderKey,
    /// `None` if the frame could not be decoded.
    pub frame: Option<Arc<Frame>>,
    pub picture: Result<RenderedPicture, ShotError>,
    /// Time since the request was started.
    pub elapsed: Duration,
}

/// Result of a request; its picture is in the texture of the request.
#[derive(Debug)]
pub struct RenderedPicture {
    pub stats: FrameStats,
    /// Shadows or real edges are approximate.
    pub is_approximate: bool,
    /// 8 bits each, as displayed.
    pub codes: Option<Arc<Pixels>>,
    /// Empty if not requested, or if the device has no timestamps.
    pub times: Vec<PartTime>,
}

/// Renders pictures in the order of the requests.
#[derive(Debug)]
pub struct FrameRenderer {
    requests: Option<Sender<RenderRequest>>,
    renderer: BackgroundTask<()>,
    finished: BackgroundTask<RenderResult>,
    in_flight: usize,
}

impl FrameRenderer {
    /// `wake` is called from a thread whenever a picture is finished.
    pub fn new(gpu: &Gpu, wake: impl Fn() + Clone + Send + 'static) -> std::io::Result<Self> {
        let (requests, incoming) = channel::<RenderRequest>();
        let (submissions, submitted) = channel::<SubmittedRequest>();
        let render_gpu = RenderGpu { gpu: gpu.clone(), wait_failed: Arc::new(AtomicBool::new(false)) };
        let wait_gpu = render_gpu.clone();
        let renderer = BackgroundTask::stream("render frames", wake.clone(), move |_| {
            render_loop(&render_gpu, &incoming, &submissions);
        })?;
        let finished = BackgroundTask::stream("wait for GPU", wake, move |reporter| {
            wait_loop(&wait_gpu, submitted, |result| reporter.send(result));
        })?;
        let (renderer, finished) = (renderer.joined(), finished.joined());
        Ok(Self { requests: Some(requests), renderer, finished, in_flight: 0 })
    }

    /// Number of unfinished pictures.
    pub fn in_flight(&self) -> usize {
        self.in_flight
    }

    /// Starts a picture. Its texture must not be shown until it is finished.
    pub fn make(&mut self, request: RenderRequest) {
        // If the thread has ended, `take` reports it.
        if self.requests.as_ref().is_some_and(|requests| requests.send(request).is_ok()) {
            self.in_flight += 1;
        }
    }

    /// The next finished picture. The error is the message of a panic, which ends rendering.
    pub fn take(&mut self) -> Result<Option<RenderResult>, String> {
        if let Some(finished) = self.finished.take() {
            self.in_flight -= 1;
            return finished.map(Some);
        }
        self.renderer.take().transpose().map(|_| None)
    }
}

/// A request whose picture is recorded, or failed.
struct SubmittedRequest {
    request: RenderRequest,
    started: Instant,
    /// `None` if the frame could not be decoded.
    frame: Option<Arc<Frame>>,
    pending: Result<Pending, ShotError>,
}

/// The GPU of both threads.
#[derive(Clone)]
struct RenderGpu {
    gpu: Gpu,
    /// Set by the waiter: results that the compositor retains may be incomplete.
    wait_failed: Arc<AtomicBool>,
}

/// Body of the thread that decodes, plans and records, until the requests end.
fn render_loop(
    RenderGpu { gpu, wait_failed }: &RenderGpu,
    incoming: &Receiver<RenderRequest>,
    submissions: &Sender<SubmittedRequest>,
) {
    let Ok(first) = incoming.recv() else { return };
    let mut scene_compositor = SceneCompositor::new(gpu.clone(), &first.shot);
    let mut reader = Reader::new(Arc::clone(&first.shot.recording));
    // During a drag the same frame is rendered repeatedly.
    let reduced = ReducedFrames::default();
    for request in std::iter::once(first).chain(incoming) {
        let started = Instant::now();
        let compositor = scene_compositor.with_scene_of(&request.shot);
        if wait_failed.swap(false, Ordering::Relaxed) {
            compositor.forget_results();
        }
        if request.outputs.times {
            compositor.time_next();
        }
        if request.key.is_approximate {
            compositor.allow_preview();
        }
        if !reader.is_of(&request.shot.recording) {
            reader = Reader::new(Arc::clone(&request.shot.recording));
        }
        let frame =
            request.live_frame.clone().map_or_else(|| reader.frame(request.key.frame, request.key.is_approximate), Ok);
        let (frame, pending) = match frame {
            Ok(frame) => {
                let pending = submit(gpu, &request, &frame, &reduced, compositor);
                if pending.is_err() {
                    compositor.forget_results();
                }
                (Some(frame), pending)
            }
            Err(error) => (None, Err(error.into())),
        };
        if submissions.send(SubmittedRequest { request, started, frame, pending }).is_err() {
            return;
        }
    }
}

/// Records the commands of a picture.
fn submit(
    gpu: &Gpu,
    request: &RenderRequest,
    frame: &Arc<Frame>,
    reduced: &ReducedFrames,
    compositor: &mut Compositor,
) -> Result<Pending, ShotError> {
    let view = request.texture.create_view(&Default::default());
    let target = Target::View(&view, FORMAT);
    let submit = || {
        if request.key.reduction > 1 {
            return submit_reduced(request, frame, reduced, compositor, target);
        }
        request
            .shot
            .geometry_at(frame.index)
            .and_then(|geometry| request.shot.submit(compositor, Frame::clone(frame), &geometry, target, false))
    };
    let failed = |source| ShotError::Gpu { frame: request.key.frame, source };
    gpu.in_error_scope(submit).map_err(failed).and_then(|pending| pending)
}

/// Body of the thread that waits for the GPU, until the pictures end or `send` returns `false`.
fn wait_loop(
    RenderGpu { gpu, wait_failed }: &RenderGpu,
    submitted: Receiver<SubmittedRequest>,
    mut send: impl FnMut(RenderResult) -> bool,
) {
    for SubmittedRequest { request, started, frame, pending } in submitted {
        let picture = pending.and_then(|pending| {
            let failed = |source| {
                wait_failed.store(true, Ordering::Relaxed);
                ShotError::Gpu { frame: request.key.frame, source }
            };
            gpu.in_error_scope(|| await_picture(gpu, &request, &pending)).and_then(|done| done).map_err(failed)
        });
        let key = request.key;
        let elapsed = started.elapsed();
        if !send(RenderResult { key, frame, picture, elapsed }) {
            return;
        }
    }
}

/// Frames by their reduction factors.
type ReducedFrames = Memo<(ByAddress<Frame>, u32), Arc<ReducedFrame>>;

/// Submits a frame at reduced size.
fn submit_reduced(
    request: &RenderRequest,
    frame: &Arc<Frame>,
    memo: &ReducedFrames,
    compositor: &mut Compositor,
    target: Target<'_>,
) -> Result<Pending, ShotError> {
    let key = (ByAddress(Arc::clone(frame)), request.key.reduction);
    let reduced = memo.get_or_insert_with(key, |(frame, reduction)| Arc::new(ReducedFrame::new(frame, *reduction)));
    request.shot.submit_reduced(compositor, &reduced, target)
}

fn await_picture(gpu: &Gpu, request: &RenderRequest, pending: &Pending) -> Result<RenderedPicture, GpuError> {
    pending.await_drawn(gpu)?;
    gpu.check()?;
    let codes = if request.outputs.codes && request.key.reduction == 1 {
        let texels = read_back(gpu, &request.texture)?;
        let codes = texels.chunks_exact(4).flat_map(|texel| [texel[0], texel[1], texel[2]]).collect();
        Pixels::from_u8(request.texture.width(), request.texture.height(), codes).map(Arc::new)
    } else {
        None
    };
    let is_approximate = pending.is_preview();
    Ok(RenderedPicture { stats: pending.stats().clone(), is_approximate, codes, times: pending.times(gpu)? })
}

impl Drop for FrameRenderer {
    fn drop(&mut self) {
        // The threads end, and the drops of their tasks wait for them.
        drop(self.requests.take());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;
    use std::path::Path;
    use std::sync::mpsc::Receiver;

    /// Reduction of the test's pictures.
    const REDUCTION: u32 = 4;

    fn renderer(gpu: &Gpu) -> (FrameRenderer, Receiver<()>) {
        let (wake, finished) = channel();
        (FrameRenderer::new(gpu, move || _ = wake.send(())).unwrap(), finished)
    }

    /// Renders a frame into a new texture with these usages, and returns its texels.
    fn rendered(
        gpu: &Gpu,
        (renderer, finished): &mut (FrameRenderer, Receiver<()>),
        shot: &Shot,
        usage: wgpu::TextureUsages,
    ) -> Result<Vec<u8>, String> {
        let [width, height] = [shot.recording.width, shot.recording.height].map(|side| side / REDUCTION);
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("test"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage,
            view_formats: &[],
        });
        let key = RenderKey { frame: 30, version: 0, is_variant: false, reduction: REDUCTION, is_approximate: false };
        let shot = shot.clone();
        let outputs = RenderOutputs::default();
        renderer.make(RenderRequest { key, shot, live_frame: None, texture: texture.clone(), outputs });
        let result = loop {
            match renderer.take().unwrap() {
                Some(result) => break result,
                None => finished.recv().unwrap(),
            }
        };
        result.picture.map_err(|error| error.to_string())?;
        Ok(read_back(gpu, &texture).unwrap())
    }

    #[test]
    fn picture_after_a_failed_one_equals_a_new_renderers() {
        let gpu = Gpu::open().unwrap();
        let options = ShotOptions { scene: Some("scenes/demo.toml".into()), ..ShotOptions::default() };
        let mut shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap();
        shot.settings.shadow.cast = false;
        let drawable = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let (mut reused, mut new) = (renderer(&gpu), renderer(&gpu));
        rendered(&gpu, &mut reused, &shot, wgpu::TextureUsages::COPY_SRC).unwrap_err();
        let after = rendered(&gpu, &mut reused, &shot, drawable).unwrap();
        assert!(after == rendered(&gpu, &mut new, &shot, drawable).unwrap());
    }
}
