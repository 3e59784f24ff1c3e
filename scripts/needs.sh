# Sourced by scripts/test, demo and hygiene and by .ci/run. Changes to the repository's root and
# installs missing system packages with apt-get (Debian, Ubuntu); on other systems lists them and
# exits with 1. Checks the version of Rust, and does not install it. `need_rust_components` is for
# scripts that format or lint.

cd "$(dirname "${BASH_SOURCE[0]}")/.."

has_vulkan_loader() {
    # ldconfig may be missing from a user's PATH. `grep -q` exits early, ldconfig may then die of
    # SIGPIPE, and pipefail would report the loader as missing.
    PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep 'libvulkan\.so\.1' >/dev/null
}

has_vulkan_driver() {
    [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] && return
    local file
    for file in /usr/share/vulkan/icd.d/*.json /usr/local/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json; do
        [ -e "$file" ] && return
    done
    return 1
}

# bindgen generates the bindings to Video4Linux at build time and loads libclang.
has_libclang() {
    [ -n "${LIBCLANG_PATH:-}" ] && return
    [ "$(uname -s)" = Linux ] || return 0
    local file
    for file in /usr/lib/llvm-*/lib/libclang.so /usr/lib*/libclang.so /usr/lib/*/libclang.so /usr/local/lib/libclang.so; do
        [ -e "$file" ] && return
    done
    return 1
}

need_packages() {
    local missing=()
    has_vulkan_loader || missing+=(libvulkan1)
    has_vulkan_driver || missing+=(mesa-vulkan-drivers)
    command -v ffmpeg >/dev/null && command -v ffprobe >/dev/null || missing+=(ffmpeg)
    command -v c++ >/dev/null || missing+=(g++)
    has_libclang || missing+=(libclang-dev)
    command -v python3 >/dev/null || missing+=(python3)
    # scripts/hygiene installs its tools into a virtual environment.
    python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
    install_missing
}

# Programs for the tests: decoders of HEIC and camera raw files, a client and an authority of time
# stamps.
need_test_programs() {
    local missing=()
    command -v heif-convert >/dev/null || missing+=(libheif-examples)
    command -v dcraw_emu >/dev/null || missing+=(libraw-bin)
    command -v curl >/dev/null || missing+=(curl)
    command -v openssl >/dev/null || missing+=(openssl)
    install_missing
}

# Installs the packages in `missing`.
install_missing() {
    [ ${#missing[@]} -eq 0 ] && return
    if ! command -v apt-get >/dev/null; then
        echo "Missing (Debian package names): ${missing[*]}." >&2
        echo "Install them with this system's package manager (a Vulkan loader and driver, of which Mesa's software driver will do, ffmpeg, a C++ compiler, libclang, Python 3; for the tests the programs of libheif and LibRaw, curl and openssl), then run this again." >&2
        exit 1
    fi
    local as_root=()
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            echo "Missing: ${missing[*]}. Run as root: apt-get install ${missing[*]}" >&2
            exit 1
        fi
        as_root=(sudo)
    fi
    echo "Installing ${missing[*]}"
    "${as_root[@]}" apt-get update
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}"
}

need_rust() {
    if ! command -v cargo >/dev/null && [ -e "$HOME/.cargo/env" ]; then
        . "$HOME/.cargo/env"
    fi
    local required installed
    required=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    installed=$(rustc --version 2>/dev/null | cut -d' ' -f2) || installed=
    if ! command -v cargo >/dev/null || [ -z "$installed" ]; then
        echo "Rust $required or newer is required and none was found: install it from https://rustup.rs, then run this again." >&2
        exit 1
    fi
    if [ "$(printf '%s\n' "$required" "$installed" | sort -V | head -n 1)" != "$required" ]; then
        echo "Rust $required or newer is required, this is $installed: run \`rustup update stable\`, or install it from https://rustup.rs." >&2
        exit 1
    fi
}

# scripts/test formats and lints; a minimal toolchain has neither component.
need_rust_components() {
    local missing=()
    cargo clippy --version >/dev/null 2>&1 || missing+=(clippy)
    cargo fmt --version >/dev/null 2>&1 || missing+=(rustfmt)
    [ ${#missing[@]} -eq 0 ] && return
    echo "Missing components of Rust: ${missing[*]}. Run \`rustup component add ${missing[*]}\`, then run this again." >&2
    exit 1
}

need_packages
need_rust
