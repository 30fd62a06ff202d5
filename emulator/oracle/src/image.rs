//! The image for the guest, which is QEMU or the bench's core. Its code loads each case's state, executes the case, and
//! stores the resulting state.
//!
//! | Address | What |
//! |---|---|
//! | 0x0000_0000 | vectors, the harness |
//! | 0x0000_1000 | the cases, [`STRIDE`] bytes each: [`Case`]'s state in the order of loading, then its code |
//! | 0x2000_0000 | the harness's variables |
//! | 0x2000_4000 | main stack, downwards |
//! | 0x2000_8000 | the memory window that is part of a case's state |
//! | 0x2100_0000 | the results, [`RESULT_WORDS`] words each |
//!
//! The image runs on QEMU's machine `mps2-an386` and needs only memory of a part. A case runs privileged, in thread
//! mode, on the process stack. A fault or `SVC` is recorded and ends the case. The interrupt handler writes its log
//! into the window.

use crate::thumb::Code;

/// The address of the first case.
pub const CASES: u32 = 0x1000;
/// The number of bytes of a case.
pub const STRIDE: u32 = 448;
/// The maximum number of cases in one image. The machine has 4 MiB at address 0.
pub const MOST_CASES: usize = 8192;
/// The address of the memory window.
pub const WINDOW: u32 = 0x2000_8000;
/// The number of words in the memory window.
pub const WINDOW_WORDS: usize = 32;
/// The address of the results.
pub const RESULTS: u32 = 0x2100_0000;
/// The number of words in one result.
pub const RESULT_WORDS: usize = 87;
/// The file to which the guest writes its results.
pub const FILE: &str = "results.bin";

const VARIABLES: u32 = 0x2000_0000;
const LOG_POINTER: u32 = 64;
/// The address of the interrupt handler's log: the upper half of the window.
const LOG: u32 = WINDOW + 64;
const STATE_BYTES: u32 = 328;
const HARNESS: u32 = 0x100;
/// The maximum number of halfwords of a case's own code. The rest of [`STRIDE`] has the initial state, an LDM of it and
/// a branch.
const MOST_CODE: usize = (STRIDE - STATE_BYTES) as usize / 2 - 4;

/// One case: an initial state and instructions.
#[derive(Clone, Debug, Default)]
pub struct Case {
    /// The contents of memory at [`WINDOW`].
    pub window: [u32; WINDOW_WORDS],
    /// The registers s0 to s31.
    pub s: [u32; 32],
    /// The register FPSCR.
    pub fpscr: u32,
    /// The APSR with its GE bits.
    pub apsr: u32,
    /// The CCR, with the traps of unaligned accesses and of divisions by zero.
    pub ccr: u32,
    /// The process stack pointer.
    pub sp: u32,
    /// The register r14.
    pub lr: u32,
    /// The registers r0 to r12.
    pub r: [u32; 13],
    /// The instructions. Execution continues behind the last one.
    pub code: Vec<u16>,
}

/// The address of the instructions of case `index`.
#[must_use]
pub fn code_address(index: usize) -> u32 {
    CASES + index as u32 * STRIDE + STATE_BYTES + 4
}

/// Builds the image of these cases.
#[must_use]
pub fn build(cases: &[Case]) -> Vec<u8> {
    assert!(cases.len() <= MOST_CASES);
    let mut harness = Code::at(HARNESS);
    let epilogue = write_epilogue(&mut harness);
    let start = write_start(&mut harness, cases.len() as u32);
    let fault = write_fault_handler(&mut harness, epilogue);
    // A later call of `link` gives this branch of the epilogue its target, the next case.
    let prologue = write_prologue(&mut harness);
    let finish = write_finish(&mut harness);
    let interrupt = write_interrupt_handler(&mut harness);
    link(&mut harness, epilogue, prologue, finish);

    let mut vectors = vec![0x2000_4000, start | 1];
    vectors.resize(14, fault | 1);
    vectors.resize(48, interrupt | 1); // PendSV, SysTick, interrupts
    let mut image: Vec<u8> = vectors.iter().flat_map(|v: &u32| v.to_le_bytes()).collect();
    image.resize(HARNESS as usize, 0);
    image.extend(harness.halves.iter().flat_map(|h| h.to_le_bytes()));
    assert!(image.len() <= CASES as usize);
    for (index, case) in cases.iter().enumerate() {
        let at = CASES + index as u32 * STRIDE;
        image.resize(at as usize, 0);
        let state = [case.fpscr, case.apsr, case.ccr, case.sp, case.lr];
        for word in case.window.iter().chain(&case.s).chain(&state).chain(&case.r) {
            image.extend(word.to_le_bytes());
        }
        assert!(case.code.len() <= MOST_CODE, "{} halfwords", case.code.len());
        let mut code = Code::at(at + STATE_BYTES);
        code.wide(0xE890_1FFF); // LDM r0, {r0-r12}
        code.halves.extend(&case.code);
        code.branch(epilogue);
        image.extend(code.halves.iter().flat_map(|h| h.to_le_bytes()));
    }
    image
}

fn write_start(code: &mut Code, cases: u32) -> u32 {
    let start = code.here();
    // CPACR enables the FPU, and SHCSR the three configurable faults.
    for (register, value) in [(0xE000_ED88, 0x00F0_0000), (0xE000_ED24, 7 << 16)] {
        code.constant(0, register).constant(1, value).store(1, 0, 0);
    }
    code.wide(0xF3BF_8F4F).wide(0xF3BF_8F6F); // DSB, ISB
    // MSR PSP, r1; MSR CONTROL, r1; ISB: from here on thread mode uses the process stack.
    code.constant(1, 0x2000_6000).wide(0xF381_8809);
    code.constant(1, 2).wide(0xF381_8814).wide(0xF3BF_8F6F);
    code.constant(0, VARIABLES);
    for (offset, value) in [(0, CASES), (4, RESULTS), (8, cases)] {
        code.constant(1, value).store(1, 0, offset);
    }
    let to_prologue = code.here();
    // `link` later gives this branch its target.
    code.branch(to_prologue);
    start
}

fn write_prologue(code: &mut Code) -> u32 {
    let prologue = code.here();
    code.constant(0, VARIABLES).load(0, 0, 0).constant(1, WINDOW);
    for _ in 0..WINDOW_WORDS / 8 {
        code.wide(0xE8B0_03FC).wide(0xE8A1_03FC); // LDM r0!, {r2-r9}; STM r1!, {r2-r9}
    }
    code.wide(0xECB0_0A20); // VLDM r0!, {s0-s31}
    code.wide(0xE8B0_003E); // LDM r0!, {r1-r5}: FPSCR, APSR, CCR, SP, LR
    code.wide(0xEEE1_1A10); // VMSR FPSCR, r1
    code.wide(0xF3BF_8F2F).narrow(0xB662); // CLREX; CPSIE i
    code.constant(6, 0xE000_ED14).store(3, 6, 0).wide(0xF3BF_8F4F).wide(0xF3BF_8F6F);
    code.constant(6, VARIABLES).constant(7, 0);
    for offset in (12..36).step_by(4) {
        code.store(7, 6, offset);
    }
    code.constant(7, LOG).store(7, 6, LOG_POINTER);
    code.narrow(0x46A5).narrow(0x46AE); // MOV sp, r4; MOV lr, r5
    code.wide(0xF382_8C00); // MSR APSR_nzcvqg, r2
    code.wide(0xF200_0135).narrow(0x4708); // ADDW r1, r0, #13 * 4 + 1; BX r1: r0 to r12 are loaded by the case itself
    prologue
}

fn write_epilogue(code: &mut Code) -> u32 {
    let epilogue = code.here();
    // No register is free yet. r0 is saved at SP + 4000, which no case accesses.
    code.store(0, 13, 4000).constant(0, VARIABLES).load(0, 0, 4);
    code.wide(0xE8A0_5FFE); // STM r0!, {r1-r12, lr}
    code.wide(0xF3EF_8100).wide(0xEEF1_2A10).wide(0xE8A0_0006); // MRS r1, APSR; VMRS r2, FPSCR; STM r0!, {r1, r2}
    code.wide(0xECA0_0A20); // VSTM r0!, {s0-s31}
    code.narrow(0x4669).load(2, 1, 4000); // MOV r1, sp
    code.constant(3, VARIABLES + 12).wide(0xE893_03F0); // LDM r3, {r4-r9}, which the fault handler wrote
    code.wide(0xE8A0_03F6); // STM r0!, {r1, r2, r4-r9}
    code.constant(1, WINDOW);
    for _ in 0..WINDOW_WORDS / 8 {
        code.wide(0xE8B1_03FC).wide(0xE8A0_03FC); // LDM r1!, {r2-r9}; STM r0!, {r2-r9}
    }
    code.constant(1, VARIABLES).store(0, 1, 4).load(2, 1, 0);
    code.wide(0xF202_12C0).store(2, 1, 0); // ADDW r2, r2, #STRIDE
    code.load(2, 1, 8).narrow(0x3A01).store(2, 1, 8); // SUBS r2, #1
    code.narrow(0xD001); // BEQ over the next instruction
    code.branch(epilogue).branch(epilogue); // to the prologue, to the finish; written by `link`
    epilogue
}

/// Writes the code that records a fault. The code returns to the epilogue.
fn write_fault_handler(code: &mut Code, epilogue: u32) -> u32 {
    let handler = code.here();
    code.wide(0xF3EF_8009).constant(2, VARIABLES); // MRS r0, PSP
    code.load(1, 0, 24).store(1, 2, 24).load(1, 0, 28).store(1, 2, 28);
    // The handler returns in Thumb state and outside any IT block. Bit 9, for the alignment of the stack, is kept.
    code.constant(3, 0xF80F_0200).narrow(0x4019).constant(3, 0x0100_0000).narrow(0x4319).store(1, 0, 28);
    code.constant(3, epilogue).store(3, 0, 24);
    code.constant(3, 0xE000_ED28).load(1, 3, 0).store(1, 2, 12);
    // TST r1, #MMARVALID; BEQ: the address of a memory management fault is stored. The address of a bus fault follows
    // in the same way.
    code.wide(0xF011_0F80).narrow(0xD003).load(12, 3, 12).store(12, 2, 20);
    code.wide(0xF411_4F00).narrow(0xD003).load(12, 3, 16).store(12, 2, 20);
    code.store(1, 3, 0).load(1, 3, 4).store(1, 2, 16).store(1, 3, 4);
    code.wide(0xF3EF_8105).wide(0xEA41_210E).store(1, 2, 32); // MRS r1, IPSR; ORR r1, r1, lr, LSL #8
    code.narrow(0x4770);
    handler
}

/// Writes the handler of PendSV, SysTick and the interrupts. It logs the active exception with EXC_RETURN, does what
/// the exception's word of the window says, clears the word, and logs the active exception with BASEPRI. The word of
/// exception n is word n % 16: bits 7:0 are interrupts to make pending, bits 15:8 go to BASEPRI_MAX, bits 28 and 26
/// make PendSV and SysTick pending, and bit 31 asks for an FP instruction.
fn write_interrupt_handler(code: &mut Code) -> u32 {
    let handler = code.here();
    code.wide(0xF3EF_8005).wide(0xEA40_200E); // MRS r0, IPSR; ORR r0, r0, lr, LSL #8
    write_log(code);
    code.wide(0xF3EF_8005).wide(0xF000_000F).constant(3, WINDOW); // MRS r0, IPSR; AND r0, r0, #15
    code.wide(0xF853_2020).constant(12, 0).wide(0xF843_C020); // LDR r2, [r3, r0, LSL #2]; STR r12, the same
    code.narrow(0x2A00).narrow(0xDA01).wide(0xEE30_0A20); // CMP r2, #0; BGE; VADD s0, s0, s1
    code.narrow(0xB672); // CPSID i, so that all of it takes effect at once
    code.constant(3, 0xE000_E200).narrow(0xB2D0).store(0, 3, 0); // UXTB r0, r2; ISPR
    code.constant(12, 5 << 26).wide(0xEA02_000C).constant(3, 0xE000_ED04).store(0, 3, 0); // AND r0, r2, r12; ICSR
    code.wide(0xF3C2_2007).wide(0xF380_8812); // UBFX r0, r2, #8, #8; MSR BASEPRI_MAX, r0
    code.narrow(0xB662).wide(0xF3BF_8F4F).wide(0xF3BF_8F6F); // CPSIE i; DSB; ISB
    // MRS r0, IPSR; MRS r3, BASEPRI; ORR r0, r0, r3, LSL #16: r0 has both registers.
    code.wide(0xF3EF_8005).wide(0xF3EF_8311).wide(0xEA40_4003);
    code.wide(0xF040_4000); // ORR r0, r0, #0x8000_0000
    write_log(code);
    code.narrow(0x4770);
    handler
}

/// Writes code that appends to the log a mix of r0 and the log's last entry. The log wraps around.
fn write_log(code: &mut Code) {
    code.constant(1, VARIABLES).load(2, 1, LOG_POINTER).load(3, 2, 0);
    code.wide(0xEA80_10F3).store(0, 2, 0); // EOR r0, r0, r3, ROR #7
    code.narrow(0x3204).wide(0xF022_0280).wide(0xF042_0240).store(2, 1, LOG_POINTER); // ADDS #4; BIC #0x80; ORR #0x40
}

/// Writes the code that ends a run: by semihosting it writes the results to [`FILE`] and exits.
fn write_finish(code: &mut Code) -> u32 {
    let finish = code.here();
    let block = VARIABLES + 0x100;
    let name = VARIABLES + 0x120;
    let mut bytes = FILE.as_bytes().to_vec();
    bytes.resize(bytes.len() / 4 * 4 + 4, 0);
    code.constant(2, name);
    for (i, word) in bytes.chunks(4).enumerate() {
        code.constant(3, u32::from_le_bytes([word[0], word[1], word[2], word[3]])).store(3, 2, 4 * i as u32);
    }
    code.constant(1, block).store(2, 1, 0);
    for (offset, value) in [(4, 5), (8, FILE.len() as u32)] {
        code.constant(3, value).store(3, 1, offset);
    }
    code.constant(0, 1).host_call(); // SYS_OPEN, "wb"
    code.constant(1, block).store(0, 1, 0).constant(3, RESULTS).store(3, 1, 4);
    code.constant(4, VARIABLES).load(4, 4, 4).narrow(0x1AE4).store(4, 1, 8); // SUBS r4, r4, r3
    code.constant(0, 5).host_call(); // SYS_WRITE
    code.constant(0, 2).constant(1, block).host_call(); // SYS_CLOSE
    code.constant(0, 0x18).constant(1, 0x2_0026).host_call(); // SYS_EXIT
    finish
}

fn link(code: &mut Code, epilogue: u32, prologue: u32, finish: u32) {
    // The image has three placeholders, each of which is a branch to itself or to the epilogue.
    let placeholders: Vec<usize> = (0..code.halves.len() - 1)
        .filter(|&i| {
            let here = code.base + 2 * i as u32;
            let bits = u32::from(code.halves[i]) << 16 | u32::from(code.halves[i + 1]);
            let to = |target: u32| bits == crate::thumb::branch_wide(target.wrapping_sub(here + 4)) | 0x9000;
            to(here) || to(epilogue)
        })
        .collect();
    assert_eq!(placeholders.len(), 3);
    // The image builder wrote the placeholders in this order: branch to the next case, branch to the end, branch to the
    // first case.
    for (at, target) in placeholders.into_iter().zip([prologue, finish, prologue]) {
        let mut branch = Code::at(code.base + 2 * at as u32);
        branch.branch(target);
        code.halves[at..at + 2].copy_from_slice(&branch.halves);
    }
}
