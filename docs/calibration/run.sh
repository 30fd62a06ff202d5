#!/bin/sh
# Runs CoreMark and AES on the clocks of the bench: docs/calibration/run.sh COREMARK AES, two folders with the sources of
# https://github.com/eembc/coremark and https://github.com/Ko-/aes-armcortexm. Needs arm-none-eabi-gcc (Debian:
# gcc-arm-none-eabi, libnewlib-arm-none-eabi), and `cargo build -p emulator` before.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
sources=${1:?the folder with the sources of CoreMark}
aes=${2:?the folder with the sources of AES}
emulator=${EMULATOR:-$here/../../target/debug/emulator}
made=$(mktemp -d)
trap 'rm -r "$made"' EXIT
flags="-O3 -mcpu=cortex-m4 -mthumb -funroll-loops -finline-functions -ffreestanding"
link() { # flash's address
    cat >"$made/link.ld" <<EOF
MEMORY { FLASH : ORIGIN = $1, LENGTH = 256K RAM : ORIGIN = 0x20000000, LENGTH = 64K }
_stack = 0x20010000;
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) . = ALIGN(4); } > FLASH
    .data : { _sdata = .; *(.data*) . = ALIGN(4); _edata = .; } > RAM AT > FLASH
    _sidata = LOADADDR(.data);
    .bss : { _sbss = .; *(.bss*) *(COMMON) . = ALIGN(4); _ebss = .; } > RAM
}
EOF
}
build() { # file, then options
    out=$1
    shift
    arm-none-eabi-gcc $flags -nostartfiles -T "$made/link.ld" -Wl,-e,start -Wl,--no-warn-rwx-segments -o "$out" "$@" \
        -lc -lgcc
}
on_all_clocks() { # part, file
    for clock in fast optimistic pessimistic; do
        "$emulator" run "$2" --part "$1" --clock "$clock" 2>&1 | grep -E 'cycles|error' | sed "s/^ *[0-9.]* ms */  $clock: /"
    done
}
for part in nrf52840 stm32f429zi; do
    case $part in
    nrf52840) link 0x00000000; name=NRF52840 ;;
    *) link 0x08000000; name=STM32F429 ;;
    esac
    for cache in 1 0; do
        build "$made/coremark" -DFLAGS_STR="\"$flags\"" -DITERATIONS=10 -DPERFORMANCE_RUN=1 -D$name -DCACHE=$cache \
            -I"$here" -I"$sources" "$sources"/core_*.c "$here/core_portme.c"
        echo "CoreMark, $part, cache $cache"
        on_all_clocks $part "$made/coremark"
    done
done
build "$made/aes" -DSINGLE "$here/aes.c" "$aes/aes128/aes.s"
echo "AES-128, single block"
on_all_clocks stm32f429zi "$made/aes"
build "$made/ctr" -DSCHEDULE_AT=16 "$here/aes.c" "$aes/aes128ctr/aes_128_ctr.s"
echo "AES-128, counter mode"
on_all_clocks stm32f429zi "$made/ctr"
build "$made/bitsliced" -DSCHEDULE_AT=0 "$here/aes.c" "$aes/aes128ctrbs/aes_128_ctr_bs.s"
echo "AES-128, bitsliced, counter mode"
on_all_clocks stm32f429zi "$made/bitsliced"
