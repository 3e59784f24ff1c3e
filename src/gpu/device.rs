//! Selects a graphics adapter and opens it.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use wgpu::{Backends, DeviceType};

use super::type_map::TypeMap;

/// An open GPU. Cheap to clone: handles only.
#[derive(Clone, Debug)]
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    /// True if passes can be timed by the GPU's clock.
    pub timestamps: bool,
    /// Number of created pipelines.
    pipelines: Arc<AtomicUsize>,
    shared: TypeMap,
    /// The first uncaptured error. Later ones are its consequences.
    failure: Arc<Mutex<Option<GpuError>>>,
}

/// Why there is no device, or why it did not finish its work.
#[derive(Clone, Debug, thiserror::Error)]
pub enum GpuError {
    /// `besides`: note on adapters excluded by an environment variable; empty if there is none.
    #[error(
        "no graphics adapter was found{besides}: Locard needs a Vulkan, Metal or DirectX 12 driver; \
         on Debian or Ubuntu without a graphics card `apt-get install mesa-vulkan-drivers libvulkan1` brings a software one"
    )]
    NoAdapter { besides: String },
    #[error("WGPU_ADAPTER_NAME={name} leaves out every graphics adapter; without it there are: {}", there.join("; "))]
    Filtered { name: String, there: Vec<String> },
    #[error("the adapter {adapter} cannot be opened: {reason}")]
    Open { adapter: String, reason: String },
    #[error("the GPU did not finish within {seconds} s; the driver may have hung")]
    Timeout { seconds: u64 },
    #[error(
        "the GPU's memory is used up: a smaller picture needs less; `locard doctor` lists the adapters of this machine"
    )]
    OutOfMemory,
    #[error("the GPU was lost: {0}")]
    Lost(String),
    #[error("the GPU failed: {0}")]
    Failed(String),
}

impl GpuError {
    /// True if the device and all its resources are lost.
    pub fn is_lost(&self) -> bool {
        matches!(self, Self::Lost(_))
    }
}

/// An adapter as reported by `locard doctor`.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    pub name: String,
    pub backend: String,
    pub driver: String,
    pub software: bool,
    pub timestamps: bool,
}

/// All adapters of this machine, best first. OpenGL is excluded, because the shaders do not draw
/// with it.
pub fn adapters() -> Vec<AdapterReport> {
    available().iter().map(report).collect()
}

fn available() -> Vec<wgpu::Adapter> {
    adapters_by_rank(Backends::from_env().unwrap_or(Backends::PRIMARY) & Backends::PRIMARY)
}

fn report(adapter: &wgpu::Adapter) -> AdapterReport {
    let info = adapter.get_info();
    AdapterReport {
        name: info.name.clone(),
        backend: info.backend.to_string(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        software: info.device_type == DeviceType::Cpu,
        timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
    }
}

/// Keeps the first adapter, and its drivers, loaded until the process exits. A thread that drops
/// the last reference during exit would unload libraries whose exit handlers are running, which
/// crashes.
fn keep_drivers(adapter: &wgpu::Adapter) {
    static FIRST: OnceLock<wgpu::Adapter> = OnceLock::new();
    FIRST.get_or_init(|| adapter.clone());
}

/// Discrete before integrated before software.
fn adapters_by_rank(backends: Backends) -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    let mut adapters = pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(backends));
    adapters.retain(|a| a.get_info().backend != wgpu::Backend::Noop);
    adapters.sort_by_key(|a| match a.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    adapters
}

fn names(adapters: &[wgpu::Adapter]) -> Vec<String> {
    let name = |a: &wgpu::Adapter| format!("{} ({})", a.get_info().name, a.get_info().backend);
    adapters.iter().map(name).collect()
}

/// The error without an adapter: the machine has none, or none that `WGPU_BACKEND` allows.
fn no_adapter() -> GpuError {
    let besides = std::env::var("WGPU_BACKEND").ok().map(|backend| {
        let there = names(&adapters_by_rank(Backends::PRIMARY));
        let left_out =
            if there.is_empty() { String::new() } else { format!(", which leaves out {}", there.join("; ")) };
        format!(" with WGPU_BACKEND={backend}{left_out}")
    });
    GpuError::NoAdapter { besides: besides.unwrap_or_default() }
}

/// An error formatted on one line.
fn one_line_error(error: &wgpu::Error) -> GpuError {
    match error {
        wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory,
        other => GpuError::Failed(other.to_string().split_whitespace().collect::<Vec<_>>().join(" ")),
    }
}

impl Gpu {
    /// True if shaders run on this machine's CPU.
    pub fn software(&self) -> bool {
        self.info.device_type == DeviceType::Cpu
    }

    /// Opens the best adapter of this machine, or the best whose name contains `WGPU_ADAPTER_NAME`.
    pub fn open() -> Result<Self, GpuError> {
        let mut there = available();
        if there.is_empty() {
            return Err(no_adapter());
        }
        let chosen = match std::env::var("WGPU_ADAPTER_NAME") {
            Ok(name) => {
                let fits = |a: &wgpu::Adapter| a.get_info().name.to_lowercase().contains(&name.to_lowercase());
                there.iter().position(fits).ok_or_else(|| GpuError::Filtered { name, there: names(&there) })?
            }
            Err(_) => 0,
        };
        let adapter = there.swap_remove(chosen);
        let (device, queue) = pollster::block_on(adapter.request_device(&Self::device_descriptor(&adapter)))
            .map_err(|e| GpuError::Open { adapter: adapter.get_info().name, reason: e.to_string() })?;
        Ok(Self::from_device(&adapter, device, queue))
    }

    /// Uses a device created elsewhere, such as by a window, with at least the limits of
    /// [`Gpu::device_descriptor`]. Its results can be displayed without a copy. From now on its
    /// uncaptured errors are collected here ([`Gpu::check`]); by default they would end the
    /// program.
    pub fn from_device(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        keep_drivers(adapter);
        let timestamps = device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let failure = Arc::new(Mutex::new(None));
        let [of_a_call, of_the_device] = [(); 2].map(|()| Arc::clone(&failure));
        let first = |failure: &Mutex<Option<GpuError>>, error: GpuError| {
            let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
            // Errors on a lost device are less informative than the loss itself.
            let is_less = |before: &GpuError| !before.is_lost() && error.is_lost();
            if failure.as_ref().is_none_or(is_less) {
                *failure = Some(error);
            }
        };
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| first(&of_a_call, one_line_error(&error))));
        device.set_device_lost_callback(move |_, message| {
            first(&of_the_device, GpuError::Lost(message.split_whitespace().collect::<Vec<_>>().join(" ")));
        });
        Self {
            device,
            queue,
            info: adapter.get_info(),
            timestamps,
            pipelines: Arc::default(),
            shared: TypeMap::default(),
            failure,
        }
    }

    /// A texture that a picture can be composited into, sampled and copied from.
    pub fn render_target(&self, (width, height): (u32, u32), format: wgpu::TextureFormat) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("render target"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// The features and limits to request, so that pictures may be as large as the adapter allows.
    pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
        wgpu::DeviceDescriptor {
            label: Some("locard"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: wgpu::Limits::default().or_better_values_from(&wgpu::Limits {
                max_texture_dimension_2d: adapter.limits().max_texture_dimension_2d.min(16384),
                max_buffer_size: adapter.limits().max_buffer_size.min(4 << 30),
                max_storage_buffer_binding_size: adapter.limits().max_storage_buffer_binding_size.min(2 << 30),
                ..wgpu::Limits::default()
            }),
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        }
    }

    /// One value per type and device, created on first use. Compositors are short-lived, and
    /// compiled pipelines are reused by the next.
    pub fn shared<T: Send + Sync + 'static>(&self, make: impl FnOnce(&Self) -> T) -> Arc<T> {
        self.shared.get(|| make(self))
    }

    /// Creates a pipeline, and counts it: drivers take up to a second for one.
    pub fn render_pipeline(&self, descriptor: &wgpu::RenderPipelineDescriptor<'_>) -> wgpu::RenderPipeline {
        self.pipelines.fetch_add(1, Ordering::Relaxed);
        self.device.create_render_pipeline(descriptor)
    }

    /// Creates a compute pipeline, and counts it.
    pub fn compute_pipeline(&self, descriptor: &wgpu::ComputePipelineDescriptor<'_>) -> wgpu::ComputePipeline {
        self.pipelines.fetch_add(1, Ordering::Relaxed);
        self.device.create_compute_pipeline(descriptor)
    }

    /// Number of pipelines created on this device.
    pub fn pipeline_count(&self) -> usize {
        self.pipelines.load(Ordering::Relaxed)
    }

    /// A buffer with these bytes, padded to four. wgpu's own `create_buffer_init` panics without
    /// memory or on a lost device; here the next [`Gpu::check`] returns the error.
    pub fn buffer(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let size = bytes.len().next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT as usize);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: size as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut padded = std::borrow::Cow::Borrowed(bytes);
        if size > bytes.len() {
            padded.to_mut().resize(size, 0);
        }
        self.queue.write_buffer(&buffer, 0, &padded);
        buffer
    }

    /// The first uncaptured error. To be called before using data that was read back: a failed call
    /// returns an unusable value, not an error.
    pub fn check(&self) -> Result<(), GpuError> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone().map_or(Ok(()), Err)
    }

    /// Takes that error, after which work continues as if there had been none. Results up to now
    /// must not be used, and a lost device stays lost.
    pub fn take_failure(&self) -> Option<GpuError> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner).take();
        if failure.is_some() {
            self.shared.clear();
        }
        failure
    }

    /// Runs work in its own error scope: errors of calls by this thread are returned here, and do
    /// not affect other users of the device. Loss of the device affects all ([`Gpu::check`]).
    pub fn in_error_scope<T>(&self, work: impl FnOnce() -> T) -> Result<T, GpuError> {
        let filters = [wgpu::ErrorFilter::OutOfMemory, wgpu::ErrorFilter::Validation, wgpu::ErrorFilter::Internal];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let done = work();
        let mut failed = None;
        // Error scopes are popped in reverse order.
        for scope in scopes.into_iter().rev() {
            failed = pollster::block_on(scope.pop()).or(failed);
        }
        match failed {
            Some(error) => {
                self.shared.clear();
                // A device reports its loss when polled.
                let _ = self.poll();
                Err(self.check().err().filter(GpuError::is_lost).unwrap_or_else(|| one_line_error(&error)))
            }
            None => Ok(done),
        }
    }

    /// Waits until a submission is done, for at most two minutes.
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        self.check()?;
        let seconds = 120;
        self.device
            .poll(wgpu::PollType::Wait { submission_index: submission, timeout: Some(Duration::from_secs(seconds)) })
            .map(|_| ())
            .map_err(|e| match e {
                wgpu::PollError::Timeout => GpuError::Timeout { seconds },
                other => GpuError::Failed(other.to_string()),
            })
    }

    /// Processes finished work without waiting.
    pub fn poll(&self) -> Result<(), GpuError> {
        self.device.poll(wgpu::PollType::Poll).map(|_| ()).map_err(|e| GpuError::Failed(e.to_string()))
    }

    /// The maximum side of a picture on this adapter, px.
    pub fn max_side_px(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four textures of 64 GiB each.
    #[test]
    fn exhausted_memory_is_an_error_and_no_panic() {
        let gpu = Gpu::open().unwrap();
        let side = gpu.max_side_px();
        let textures: Vec<_> = (0..4)
            .map(|_| {
                gpu.device.create_texture(&wgpu::TextureDescriptor {
                    label: Some("too large"),
                    size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 16 },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format: wgpu::TextureFormat::Rgba32Float,
                    usage: wgpu::TextureUsages::TEXTURE_BINDING,
                    view_formats: &[],
                })
            })
            .collect();
        let error = gpu.wait(None).unwrap_err();
        assert!(matches!(error, GpuError::OutOfMemory), "{error}");
        assert!(!error.to_string().contains('\n'));
        drop(textures);
    }

    /// The contents of a buffer must not matter on a lost device.
    #[test]
    fn buffer_on_a_lost_device_is_an_error_and_no_panic() {
        let gpu = Gpu::open().unwrap();
        let made = gpu.buffer("five bytes", &[7; 5], wgpu::BufferUsages::COPY_SRC);
        assert_eq!(made.size(), 8);
        gpu.wait(None).unwrap();
        gpu.device.destroy();
        let late = || gpu.buffer("too late", &[7; 4], wgpu::BufferUsages::COPY_SRC);
        late();
        assert!(!gpu.check().unwrap_err().is_lost());
        assert!(gpu.in_error_scope(late).unwrap_err().is_lost());
        // The loss takes precedence over earlier errors.
        assert!(gpu.check().unwrap_err().is_lost());
    }

    /// A buffer beyond the size limit.
    #[test]
    fn error_scope_reports_only_its_own_errors() {
        let gpu = Gpu::open().unwrap();
        let too_large = || {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("too large"),
                size: u64::MAX / 2,
                usage: wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        assert_eq!(gpu.in_error_scope(|| 7).unwrap(), 7);
        // Another thread's error is not reported in this scope.
        let elsewhere = || {
            std::thread::scope(|scope| {
                let other = std::thread::Builder::new().spawn_scoped(scope, || drop(too_large())).unwrap();
                other.join().unwrap();
            });
        };
        gpu.in_error_scope(elsewhere).unwrap();
        assert!(gpu.take_failure().is_some());
        gpu.in_error_scope(too_large).unwrap_err();
        gpu.check().unwrap();
    }
}
