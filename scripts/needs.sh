# Sourced by the scripts beside it: goes to the repository's root and sees to it that what they
# need is there. Installs with apt-get on Debian and Ubuntu, and only what is missing; elsewhere
# it says what is needed.

cd "$(dirname "${BASH_SOURCE[0]}")/.."

has_vulkan_loader() {
    # ldconfig may be outside of a user's PATH. With pipefail, grep -q would end ldconfig by SIGPIPE and fail at times.
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

# Bindings to the system's cameras are made when they are built.
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
    [ ${#missing[@]} -eq 0 ] && return

    if ! command -v apt-get >/dev/null; then
        echo "Missing, by Debian's names: ${missing[*]}." >&2
        echo "Install a Vulkan loader and driver (Mesa's software driver will do), ffmpeg, a C++ compiler and libclang with this system's own tools, then start again." >&2
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
    local wanted found
    wanted=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    found=$(rustc --version 2>/dev/null | cut -d' ' -f2) || found=
    if ! command -v cargo >/dev/null || [ -z "$found" ]; then
        echo "Rust $wanted or newer is needed and there is none: get it from https://rustup.rs, then start again." >&2
        exit 1
    fi
    if [ "$(printf '%s\n' "$wanted" "$found" | sort -V | head -n 1)" != "$wanted" ]; then
        echo "Rust $wanted or newer is needed, this is $found: \`rustup update stable\`, or get it from https://rustup.rs." >&2
        exit 1
    fi
}

need_packages
need_rust
