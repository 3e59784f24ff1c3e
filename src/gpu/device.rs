//! Finding an adapter and opening it.

use std::time::Duration;

use wgpu::{Backends, DeviceType};

/// An open GPU. Cheap to clone: handles only.
#[derive(Clone, Debug)]
pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    /// Whether passes can be timed on the GPU's own clock.
    pub timestamps: bool,
}

#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    #[error(
        "no graphics adapter was found: Locard needs a Vulkan, Metal, DirectX 12 or OpenGL ES 3.1 driver; \
         on Debian or Ubuntu without a graphics card `apt-get install mesa-vulkan-drivers libvulkan1` brings a software one"
    )]
    NoAdapter,
    #[error(
        "{filter} leaves out every graphics adapter that there is; without it there {}",
        match there.as_slice() {
            [] => "are none either: `locard doctor` says what to install".to_owned(),
            names => format!("are: {}", names.join("; ")),
        }
    )]
    Filtered { filter: String, there: Vec<String> },
    #[error("the adapter {adapter} cannot be opened: {reason}")]
    Open { adapter: String, reason: String },
    #[error("the GPU did not finish within {seconds} s; the driver may have hung")]
    Timeout { seconds: u64 },
    #[error("the GPU failed: {0}")]
    Failed(String),
}

/// What `locard doctor` says of one adapter.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    pub name: String,
    pub backend: String,
    pub driver: String,
    pub software: bool,
    pub timestamps: bool,
}

/// All adapters of this machine, best first; OpenGL's only where there are no others, for
/// opening it is slow and talks on stderr.
pub fn adapters() -> Vec<AdapterReport> {
    available().iter().map(report).collect()
}

fn available() -> Vec<wgpu::Adapter> {
    if let Some(backends) = Backends::from_env() {
        return ranked(backends);
    }
    let adapters = ranked(Backends::PRIMARY);
    if adapters.is_empty() { ranked(Backends::GL) } else { adapters }
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

/// Discrete before integrated before software; Vulkan, Metal and DirectX before OpenGL.
fn ranked(backends: Backends) -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    let mut adapters = pollster::block_on(wgpu::Instance::new(descriptor).enumerate_adapters(backends));
    adapters.retain(|a| a.get_info().backend != wgpu::Backend::Noop);
    adapters.sort_by_key(|a| {
        let info = a.get_info();
        let kind = match info.device_type {
            DeviceType::DiscreteGpu => 0,
            DeviceType::IntegratedGpu => 1,
            DeviceType::VirtualGpu => 2,
            DeviceType::Other => 3,
            DeviceType::Cpu => 4,
        };
        (kind, info.backend == wgpu::Backend::Gl)
    });
    adapters
}

/// Why there is none: a variable filters them all out, or the machine has none.
fn none() -> GpuError {
    let set = |name| std::env::var(name).ok().map(|value| format!("{name}={value}"));
    let filters: Vec<String> = ["WGPU_ADAPTER_NAME", "WGPU_BACKEND"].into_iter().filter_map(set).collect();
    if filters.is_empty() {
        return GpuError::NoAdapter;
    }
    let named = |a: &wgpu::Adapter| format!("{} ({})", a.get_info().name, a.get_info().backend);
    let there = [Backends::PRIMARY, Backends::GL].map(ranked).iter().flatten().map(named).collect();
    GpuError::Filtered { filter: filters.join(" with "), there }
}

impl Gpu {
    /// Opens the best adapter of this machine; `WGPU_ADAPTER_NAME` picks one whose name
    /// contains it.
    pub fn open() -> Result<Self, GpuError> {
        let wanted = std::env::var("WGPU_ADAPTER_NAME").ok().map(|name| name.to_lowercase());
        let adapter = available()
            .into_iter()
            .find(|a| wanted.as_ref().is_none_or(|w| a.get_info().name.to_lowercase().contains(w)))
            .ok_or_else(none)?;
        let info = adapter.get_info();
        let timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("locard"),
            required_features: if timestamps { wgpu::Features::TIMESTAMP_QUERY } else { wgpu::Features::empty() },
            required_limits: wgpu::Limits::default().or_better_values_from(&wgpu::Limits {
                max_texture_dimension_2d: adapter.limits().max_texture_dimension_2d.min(16384),
                max_buffer_size: adapter.limits().max_buffer_size.min(4 << 30),
                max_storage_buffer_binding_size: adapter.limits().max_storage_buffer_binding_size.min(2 << 30),
                ..wgpu::Limits::default()
            }),
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| GpuError::Open { adapter: info.name.clone(), reason: e.to_string() })?;
        Ok(Self { device, queue, info, timestamps })
    }

    /// Waits until a submission is done, at most two minutes.
    pub fn wait(&self, submission: Option<wgpu::SubmissionIndex>) -> Result<(), GpuError> {
        let seconds = 120;
        self.device
            .poll(wgpu::PollType::Wait { submission_index: submission, timeout: Some(Duration::from_secs(seconds)) })
            .map(|_| ())
            .map_err(|e| match e {
                wgpu::PollError::Timeout => GpuError::Timeout { seconds },
                other => GpuError::Failed(other.to_string()),
            })
    }

    /// The largest side of a picture that this adapter can hold, px.
    pub fn max_side_px(&self) -> u32 {
        self.device.limits().max_texture_dimension_2d
    }
}
