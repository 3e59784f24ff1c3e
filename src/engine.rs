//! Locard puts virtual evidence into real footage so that it appears photographed there by the same
//! camera at the same moment.
//!
//! source → frame + pose → virtual layer → lens effects → composite → sensor effects → sink. The
//! folders follow that sentence; ARCHITECTURE.md has the rest.

// 0: plain values
pub mod assets;
pub mod cleanup;
pub mod coding;
pub mod digest;
pub mod document;
pub mod frame;
pub mod grey_image;
pub mod hash;
pub mod interpolation;
pub mod label;
pub mod memo;
pub mod parallel;
pub mod params;
pub mod pixels;
pub mod plane;
pub mod pose;
pub mod program;
pub mod quality;
pub mod stage;
pub mod text;
pub mod user_folders;
pub mod yaml;

// 1: physics without GPU or files; least-squares fits and poses
pub mod camera;
pub mod example_noise;
pub mod fit;

// 2: input and output, recordings and their depth, streams of poses, tags, cameras; the GPU
pub mod depth;
pub mod gpu;
pub mod recording;
pub mod sink;
pub mod site;
pub mod source;
pub mod stream;
pub mod tags;
pub mod tracking;
pub mod webcam;

// 3: the scene, the supports of its objects, and the virtual layer drawn from it
pub mod render;
pub mod scene;
pub mod shadow;
pub mod support;

// 4: effects of lens and sensor
pub mod effects;

// 5: the frame loop; camera profiles
pub mod compositor;
pub mod profile;

// 6: composited footage and its files; cost, noise calibration, comparison, photographs, simulated
// recordings, structure from motion
pub mod analyse;
pub mod bench;
pub mod calibrate;
pub mod export;
pub mod farm;
pub mod live;
pub mod measure;
pub mod photo;
pub mod provenance;
pub mod report;
pub mod sfm;
pub mod shot;
pub mod simulate;
pub mod verify;
