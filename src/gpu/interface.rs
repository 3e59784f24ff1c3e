//! Reflection of a module's globals by name, from the WGSL text.

use std::collections::BTreeMap;

use wgpu::naga;
use wgpu::naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};

/// A parsed module.
#[derive(Debug)]
pub struct Interface {
    label: String,
    module: naga::Module,
    info: ModuleInfo,
}

/// A global that a shader reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Global {
    pub name: String,
    pub group: u32,
    pub binding: u32,
    pub kind: wgpu::BindingType,
    pub visibility: wgpu::ShaderStages,
    /// Size of a uniform, bytes.
    pub size: u32,
    /// Name and offset of each member of a uniform. Tables have no members.
    pub members: Vec<(String, u32)>,
}

impl Global {
    /// Checks that the members of a Rust uniform have the shader's offsets. Padding members may
    /// differ.
    ///
    /// # Panics
    /// On a mismatch: a programming error.
    pub fn check_layout(&self, size: usize, members: &[(&str, usize)]) {
        let ours: Vec<_> = members.iter().map(|(name, offset)| (*name, *offset as u32)).collect();
        let theirs: Vec<_> = self.members.iter().map(|(name, offset)| (name.as_str(), *offset)).collect();
        let named =
            |all: Vec<(_, _)>| all.into_iter().filter(|(name, _): &(&str, u32)| !name.starts_with("unused")).collect();
        let [ours, theirs]: [Vec<_>; 2] = [named(ours), named(theirs)];
        assert_eq!(ours, theirs, "members of {} and their offsets, in Rust and in WGSL", self.name);
        let size = size.next_multiple_of(16) as u32;
        assert!(size >= self.size, "{} has {size} bytes, the shader reads {}", self.name, self.size);
    }
}

impl Interface {
    /// # Panics
    /// If the text is not valid WGSL: a programming error that the shader test finds. The message
    /// contains the location.
    pub fn new(label: &str, text: &str) -> Self {
        let module =
            naga::front::wgsl::parse_str(text).unwrap_or_else(|e| panic!("{label}: {}", e.emit_to_string(text)));
        let info = Validator::new(ValidationFlags::all(), Capabilities::all())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{label}: {}", e.emit_to_string(text)));
        Self { label: label.to_owned(), module, info }
    }

    /// All globals that some entry points read, by name.
    ///
    /// # Panics
    /// If there is no such entry point.
    pub fn globals(&self, entries: &[&str]) -> BTreeMap<String, Global> {
        let mut of_entries: BTreeMap<String, Global> = BTreeMap::new();
        for entry in entries {
            let at = self.module.entry_points.iter().position(|e| e.name == *entry);
            let at = at.unwrap_or_else(|| panic!("{}: there is no entry {entry}", self.label));
            let stage = match self.module.entry_points[at].stage {
                naga::ShaderStage::Vertex => wgpu::ShaderStages::VERTEX,
                naga::ShaderStage::Compute => wgpu::ShaderStages::COMPUTE,
                _ => wgpu::ShaderStages::FRAGMENT,
            };
            let uses = self.info.get_entry_point(at);
            let own = self.module.global_variables.iter().filter(|(handle, _)| !uses[*handle].is_empty());
            for (handle, global) in own {
                let Some(place) = global.binding else { continue };
                let sampled = uses.sampling_set.iter().any(|key| key.image == handle);
                let name = global.name.clone().unwrap_or_default();
                let new = self.global(&name, global, place, sampled);
                let global = of_entries.entry(name).or_insert_with(|| new.clone());
                global.visibility |= stage;
                // One of the entries may only load a texture that another samples.
                if sampled {
                    global.kind = new.kind;
                }
            }
        }
        of_entries
    }

    /// True if the module has a global of this name.
    pub fn has_global(&self, name: &str) -> bool {
        self.module.global_variables.iter().any(|(_, g)| g.name.as_deref() == Some(name))
    }

    fn global(&self, name: &str, global: &naga::GlobalVariable, place: naga::ResourceBinding, sampled: bool) -> Global {
        let inner = &self.module.types[global.ty].inner;
        let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
        let texture = |sample_type, multisampled| wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled,
        };
        let kind = match (global.space, inner) {
            (naga::AddressSpace::Uniform, _) => buffer(wgpu::BufferBindingType::Uniform),
            (naga::AddressSpace::Storage { access }, _) => {
                let read_only = !access.contains(naga::StorageAccess::STORE);
                buffer(wgpu::BufferBindingType::Storage { read_only })
            }
            (_, naga::TypeInner::Sampler { .. }) => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            (_, naga::TypeInner::Image { class, .. }) => match *class {
                naga::ImageClass::Depth { multi } => texture(wgpu::TextureSampleType::Depth, multi),
                naga::ImageClass::Sampled { kind, multi } => texture(
                    match kind {
                        naga::ScalarKind::Sint => wgpu::TextureSampleType::Sint,
                        naga::ScalarKind::Uint => wgpu::TextureSampleType::Uint,
                        // Textures that are only loaded may have 32-bit floats.
                        _ => wgpu::TextureSampleType::Float { filterable: sampled && !multi },
                    },
                    multi,
                ),
                _ => panic!("{}: {name} is of a kind that nothing here binds", self.label),
            },
            _ => panic!("{}: {name} is of a kind that nothing here binds", self.label),
        };
        let members = match inner {
            naga::TypeInner::Struct { members, .. } => {
                members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset)).collect()
            }
            _ => Vec::new(),
        };
        let size = inner.size(self.module.to_ctx());
        let visibility = wgpu::ShaderStages::NONE;
        Global { name: name.to_owned(), group: place.group, binding: place.binding, kind, visibility, size, members }
    }
}

/// The bind group layouts, and the pipeline layout.
pub fn layouts(
    device: &wgpu::Device,
    label: &str,
    globals: &BTreeMap<String, Global>,
) -> (Vec<Option<wgpu::BindGroupLayout>>, wgpu::PipelineLayout) {
    let count = globals.values().map(|g| g.group + 1).max().unwrap_or(0);
    let groups: Vec<_> = (0..count)
        .map(|group| {
            let mut entries: Vec<_> = globals
                .values()
                .filter(|g| g.group == group)
                .map(|g| wgpu::BindGroupLayoutEntry {
                    binding: g.binding,
                    visibility: g.visibility,
                    ty: g.kind,
                    count: None,
                })
                .collect();
            entries.sort_by_key(|e| e.binding);
            let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries };
            (!entries.is_empty()).then(|| device.create_bind_group_layout(&descriptor))
        })
        .collect();
    let pipeline = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &groups.iter().map(Option::as_ref).collect::<Vec<_>>(),
        immediate_size: 0,
    });
    (groups, pipeline)
}
