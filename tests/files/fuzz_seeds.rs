//! Runs the fuzz targets on their seeds and on past failures, and keeps the targets compiling.

use crate::bodies;
use crate::tier;

fn seeds(target: &str) -> Vec<Vec<u8>> {
    let files = std::fs::read_dir(format!("fuzz/seeds/{target}")).unwrap();
    files.map(|file| std::fs::read(file.unwrap().path()).unwrap()).collect()
}

#[test]
fn gltf_seeds_and_their_mutations_never_panic() {
    let seeds = seeds("gltf");
    assert!(!seeds.is_empty());
    seeds.iter().for_each(|seed| bodies::gltf(seed));
    // Truncated at many lengths, and with many bytes changed.
    for seed in seeds {
        for i in (0..seed.len()).step_by(tier::fast_or_full(21, 7)) {
            bodies::gltf(&seed[..i]);
            let mut damaged = seed.clone();
            damaged[i] ^= 1 << (i % 8);
            bodies::gltf(&damaged);
        }
    }
}

#[test]
fn picture_seeds_and_their_mutations_never_panic() {
    let seeds = seeds("picture");
    let decoded = seeds.iter().filter(|seed| bodies::picture(seed)).count();
    assert_eq!(decoded, seeds.len() - 2, "all but the HEIC and the DWA, which other programs decode");
    for seed in seeds {
        for i in (0..seed.len()).step_by(tier::fast_or_full(29, 1)) {
            bodies::picture(&seed[..i]);
            let mut damaged = seed.clone();
            damaged[i] ^= 1 << (i % 8);
            bodies::picture(&damaged);
        }
    }
}

#[test]
fn recording_seeds_never_panic() {
    let seeds = seeds("recording");
    assert!(!seeds.is_empty());
    let readable = seeds.iter().filter(|seed| bodies::recording(seed) == 2).count();
    assert_eq!(readable, seeds.len() - 1, "all but the video, whose file is not there");
    for seed in seeds {
        for i in (0..seed.len()).step_by(tier::fast_or_full(29, 1)) {
            bodies::recording(&seed[..i]);
            let mut damaged = seed.clone();
            damaged[i] ^= 1 << (i % 8);
            bodies::recording(&damaged);
        }
    }
}

#[test]
fn scan_seeds_and_their_mutations_never_panic() {
    let seeds = seeds("scan");
    assert!(!seeds.is_empty());
    assert!(seeds.iter().all(|seed| bodies::scan(seed)));
    for seed in seeds {
        for i in (0..seed.len()).step_by(tier::fast_or_full(41, 1)) {
            bodies::scan(&seed[..i]);
            let mut damaged = seed.clone();
            damaged[i] ^= 1 << (i % 8);
            bodies::scan(&damaged);
        }
    }
}

#[test]
fn stream_seeds_never_panic() {
    let seeds = seeds("stream");
    assert!(!seeds.is_empty());
    for seed in seeds {
        // The third packet of `pieces` has another sender, whose pieces are numbered differently.
        assert_eq!(bodies::stream(&seed), 3, "each holds three poses");
        for i in (0..seed.len()).step_by(tier::fast_or_full(3, 1)) {
            bodies::stream(&seed[..i]);
            let mut damaged = seed.clone();
            damaged[i] ^= 1 << (i % 8);
            bodies::stream(&damaged);
        }
    }
}
