#!/usr/bin/env bash
# The host's command and the emulated DLPC900 with a real USB stack between them: Debian's kernel in an emulated PC, whose host
# controller loops back to a gadget. Needs qemu-system-x86, cpio and busybox-static; fetches the kernel's package with apt. Takes what
# `cargo build --workspace` has made: run.sh [FOLDER OF THE BINARIES]
set -euo pipefail
cd "$(dirname "$0")/../.."
built=${1:-${CARGO_TARGET_DIR:-target}/debug}
work=${CARGO_TARGET_DIR:-target}/guest
mkdir -p "$work"

# The kernel, once.
if [ ! -e "$work/vmlinuz" ]; then
    package=$(apt-cache depends linux-image-amd64 | sed -nE 's/^ *Depends: (linux-image-[0-9].*)/\1/p' | head -n 1)
    (cd "$work" && apt-get download "$package" >/dev/null && dpkg-deb -x "$package"_*.deb kernel && rm -f "$package"_*.deb)
    cp "$work"/kernel/boot/vmlinuz-* "$work/vmlinuz"
fi

root=$work/root
rm -rf "$root"
mkdir -p "$root"/{bin,modules,proc,sys,dev,etc,tmp,patterns}
cp hil/guest/init "$root/init"
chmod +x "$root/init"
cp /bin/busybox "$root/bin/"
echo 'root:x:0:0::/:/bin/sh' >"$root/etc/passwd"
# In the order in which they need each other.
for name in configfs usb-common usbcore udc-core libcomposite dummy_hcd usb_f_hid hid hid-generic usbhid; do
    module=$(find "$work/kernel" -name "$name.ko*" | sort | head -n 1)
    # What is not a module is part of the kernel.
    [ -n "$module" ] || continue
    case $module in
        *.xz) xz -dc "$module" >"$root/modules/$name.ko" ;;
        *) cp "$module" "$root/modules/$name.ko" ;;
    esac
    echo "$name.ko" >>"$root/modules/order"
done
for program in rcg dlpc900-gadget; do
    cp "$built/$program" "$root/bin/"
    strip "$root/bin/$program" 2>/dev/null || true
    ldd "$built/$program" | grep -o '/[^ ]*' | while read -r library; do
        mkdir -p "$root$(dirname "$library")"
        cp -L "$library" "$root$library"
    done
done
"$built/rcg" patterns --rig rcg-1-16bit --step 45 --out "$work/patterns.$$" -q >/dev/null
mv "$work/patterns.$$"/*.png "$root/patterns/"
rm -rf "$work/patterns.$$"
count=$(find "$root/patterns" -name '*.png' | wc -l)
(cd "$root" && find . | cpio --quiet -o -H newc | gzip -1) >"$work/initrd"

# What it says lands in a file, whatever becomes of it; it needs half a minute on an idle machine.
timeout 300 qemu-system-x86_64 -m 1024 -display none -monitor none -serial "file:$work/guest.log" -no-reboot \
    -kernel "$work/vmlinuz" -initrd "$work/initrd" -append 'console=ttyS0 panic=-1 quiet' </dev/null || true
cat "$work/guest.log"

expect() {
    grep -qF -- "$1" "$work/guest.log" || { echo "hil/guest: expected in what the guest says: $1" >&2; exit 1; }
}
expect '/dev/hidraw0  DLPC900  A17'
expect 'DLP5500 at /dev/hidraw0'
expect '25 stripes of growing width'
expect 'gadget: 25 patterns run'
expect "gadget: $count patterns run"
expect 'projector B4: expected a DLPC900 of this serial number or device file, found /dev/hidraw0 with serial number A17'
expect 'expected leave to read and write it, found none'
expect 'guest: done'
if grep -F 'complaint' "$work/guest.log"; then
    echo "hil/guest: the unit complains" >&2
    exit 1
fi
echo "the command drove a DLPC900 over the kernel's hidraw: $count patterns"
