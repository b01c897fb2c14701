#!/usr/bin/env python3
"""Drives with one defect each: a source of the drive in which one text is replaced.

    defects.py list                     NAME SOURCE CHECK of every defect, a line each
    defects.py write TREE NAME OUTPUT   the source of TREE with the defect
    defects.py check TREE               whether every old text is there exactly once
"""
import pathlib
import sys

SDO, BLOCK, PDO, EMCY = "hil/canopen/sdo.cc", "hil/canopen/sdo_block.cc", "hil/canopen/pdo.cc", "hil/canopen/emcy.cc"
HEARTBEAT, DICTIONARY = "hil/canopen/heartbeat.cc", "hil/canopen/dictionary.cc"
STATES, PROFILE, NODE = "hil/cia402/state_machine.cc", "hil/cia402/drive_profile.cc", "hil/cia402/node.cc"

DEFECTS = [  # name, source, old text, new text, a check that fails
    (
        "toggle_bit_ignored",
        SDO,
        "if (static_cast<bool>(command & toggle_bit) != transfer_.toggle)",
        "if (false)",
        "sdo.upload_toggle",
    ),
    (
        "announced_length_wrong",
        SDO,
        "encode(static_cast<std::int64_t>(value.size())",
        "encode(static_cast<std::int64_t>(value.size() + 1)",
        "sdo.segmented_upload",
    ),
    (
        "answer_without_sub_index",
        SDO,
        "static_cast<std::uint8_t>(index_ >> 8), sub_};",
        "static_cast<std::uint8_t>(index_ >> 8), 0};",
        "sdo.names_the_object",
    ),
    (
        "unsized_download_of_4_bytes",
        SDO,
        "if (!sized)  // the size is that of the object",
        "if (false)",
        "sdo.size_not_indicated",
    ),
    (
        "crc_of_blocks_ignored",
        BLOCK,
        "if (transfer_.crc && sdo_crc(transfer_.bytes) !=",
        "if (false && 0 !=",
        "sdo.block_crc",
    ),
    (
        "constants_written",
        DICTIONARY,
        "if (o->access != Access::read_write && o->access != Access::write_only) return",
        "if (o->access == Access::read_only) return",
        "sdo.read_only",
    ),
    (
        "short_values_accepted",
        DICTIONARY,
        "if (bytes < longest(o) && is_number(o.type)) return",
        "if (bytes == 0) return",
        "sdo.too_short",
    ),
    (
        "heartbeat_too_slow",
        HEARTBEAT,
        "last_ns_ = now_ns - last_ns_ > 2 * period ? now_ns : last_ns_ + period;",
        "last_ns_ = now_ns + period / 4;",
        "heartbeat.period",
    ),
    ("boot_up_message_wrong", HEARTBEAT, "boot[] = {0};", "boot[] = {0x7F};", "nmt.boot_up"),
    (
        "watched_before_first_heartbeat",
        HEARTBEAT,
        "if (w.period_ns && w.last_ns >= 0 && now_ns - w.last_ns > w.period_ns) {\n      w.last_ns = -1;",
        "if (w.period_ns && now_ns - w.last_ns > w.period_ns) {\n      w.last_ns = now_ns;",
        "consumer.not_begun",
    ),
    ("node_watched_twice", HEARTBEAT, "watched_[i].node == wanted.node", "false", "consumer.twice"),
    (
        "history_forgets",
        EMCY,
        "for (std::uint8_t i = history_size; i > 1; --i)",
        "for (std::uint8_t i = 1; i > 1; --i)",
        "emcy.history_order",
    ),
    ("no_error_reset", EMCY, "if (before == 0) send(0, {});", "", "emcy.end"),
    (
        "short_pdo_accepted",
        PDO,
        "if (static_cast<int>(bytes.size()) < pdo.size) {",
        "if (bytes.empty()) {",
        "rpdo.short",
    ),
    ("one_sync_too_many", PDO, "++pdo.syncs >= pdo.type", "++pdo.syncs > pdo.type", "pdo.every_third_sync"),
    (
        "restricted_identifiers",
        PDO,
        "if (exists && cob::restricted(id)) return",
        "if (false) return",
        "pdo.restricted_identifiers",
    ),
    ("inhibit_time_too_short", PDO, "d.get(index, 3) * 100'000", "d.get(index, 3) * 10'000", "pdo.inhibit_time"),
    (
        "pdo_before_its_sync",
        PDO,
        "if (pdo.synchronous())\n      pdo.pending = true;",
        "if (false)\n      pdo.pending = true;",
        "rpdo.with_sync",
    ),
    ("fault_reset_by_level", STATES, "(word & 0x80) && !(last_ & 0x80)", "(word & 0x80)", "state.15_edge"),
    ("no_way_back_from_quick_stop", STATES, "if (command == Command::enable && hold_)", "if (false)", "state.16"),
    (
        "quick_stop_ignored_without_power",
        STATES,
        "if (command == Command::disable_voltage || command == Command::quick_stop) state_",
        "if (command == Command::disable_voltage) state_",
        "state.10_quick_stop",
    ),
    ("quick_stop_never_held", STATES, "hold_ = o.quick_stop >= 5;", "hold_ = false;", "quick_stop.6"),
    ("sdo_while_stopped", NODE, "if (context_.nmt == Nmt::stopped) return;", "", "nmt.no_sdo_in_stopped"),
    (
        "stop_leaves_the_torque",
        NODE,
        "if (left && (before == Nmt::operational || drive_.machine().powered()))",
        "if (false)",
        "abort_connection.stop_1",
    ),
    ("unknown_modes_accepted", PROFILE, "&& value != no_mode && !find_mode(value)", "&& false", "mode.unsupported"),
    ("not_remote", PROFILE, "if (node_.operational()) word |= remote;", "", "status.remote"),
]


def defective(tree, source, old, new):
    text = (pathlib.Path(tree) / source).read_text()
    count = text.count(old)
    if count != 1:
        sys.exit(f"{source}: {count} times instead of once: {old}")
    return text.replace(old, new)


if __name__ == "__main__":
    command, *arguments = sys.argv[1:]
    if command == "list":
        print("\n".join(f"{name} {source} {check}" for name, source, _, _, check in DEFECTS))
    elif command == "write":
        tree, name, output = arguments
        _, source, old, new, _ = next(d for d in DEFECTS if d[0] == name)
        pathlib.Path(output).write_text(defective(tree, source, old, new))
    elif command == "check":
        for _, source, old, new, _ in DEFECTS:
            defective(arguments[0], source, old, new)
        if len({d[0] for d in DEFECTS}) != len(DEFECTS):
            sys.exit("two defects have one name")
        print(f"{len(DEFECTS)} defects")
    else:
        sys.exit(__doc__)
