//! Formats that are not read, each with advice how to export one that is.

/// Length of the longest signature below and of the formats that are read.
pub(super) const SIGNATURE_BYTES: usize = 20;

struct RefusedFormat {
    extensions: &'static [&'static str],
    /// First bytes. Empty if the extension alone decides.
    magic: &'static [u8],
    advice: &'static str,
}

const REFUSED: [RefusedFormat; 13] = [
    RefusedFormat {
        extensions: &["rcp", "rcs"],
        magic: b"",
        advice: "projects and scans of ReCap are not read; in ReCap, export them as E57",
    },
    RefusedFormat {
        extensions: &["fls", "fws", "lsproj"],
        magic: b"",
        advice: "scans of FARO SCENE are not read; in SCENE, export the scan points as E57",
    },
    RefusedFormat {
        extensions: &["ptx", "ptg"],
        magic: b"",
        advice: "scans of Leica Cyclone (PTX, PTG) are not read; open the file in CloudCompare and save it as E57",
    },
    RefusedFormat {
        extensions: &["zfs", "zfc", "rsp", "rdbx", "rxp", "cl3", "clr"],
        magic: b"",
        advice: "a scanner's own files are not read; in the scanner's program, export E57",
    },
    RefusedFormat {
        extensions: &["pcd"],
        magic: b"# .PCD",
        advice: "files of the Point Cloud Library (PCD) are not read; open the file in CloudCompare and save it as PLY",
    },
    RefusedFormat {
        extensions: &["usdz", "usd", "usda", "usdc"],
        magic: b"PXR-USDC",
        advice: "USD is not read; in Polycam or another scanning app, export GLB or PLY, or open the file in \
                 Blender and export .glb",
    },
    RefusedFormat {
        extensions: &["fbx", "dae", "3ds", "blend", "3mf", "wrl", "x3d"],
        magic: b"Kaydara FBX Binary",
        advice: "this format of meshes is not read; open the file in Blender and export .glb",
    },
    RefusedFormat {
        extensions: &["splat", "spz", "sog", "ksplat"],
        magic: b"",
        advice: "Gaussian splats are not read, since their centres are no surface; export a mesh or a point cloud as \
                 PLY or GLB",
    },
    RefusedFormat {
        extensions: &["bin"],
        magic: b"CCB2",
        advice: "projects of CloudCompare are not read; in CloudCompare, save the cloud or the mesh as E57 or PLY",
    },
    RefusedFormat {
        extensions: &["zip"],
        magic: b"PK\x03\x04",
        advice: "it is a ZIP archive; unpack it and name the scan inside",
    },
    RefusedFormat {
        extensions: &["gz"],
        magic: b"\x1f\x8b",
        advice: "it is compressed (gzip); unpack it with `gunzip`",
    },
    RefusedFormat {
        extensions: &["7z"],
        magic: b"7z\xbc\xaf\x27\x1c",
        advice: "it is a 7z archive; unpack it and name the scan inside",
    },
    RefusedFormat {
        extensions: &["png", "jpg", "jpeg", "tif", "tiff", "pdf", "mp4", "mov"],
        magic: b"",
        advice: "pictures and films are no scans; name the file with the points, such as .e57, .ply or .glb",
    },
];

/// Why a file is refused, and the way to export one that is read. The extension counts before the
/// content: USDZ is a ZIP archive.
pub(super) fn advice(start: &[u8], extension: &str) -> Option<&'static str> {
    let by_extension = REFUSED.iter().find(|format| format.extensions.contains(&extension));
    let by_content = || REFUSED.iter().find(|format| !format.magic.is_empty() && start.starts_with(format.magic));
    by_extension.or_else(by_content).map(|format| format.advice)
}
