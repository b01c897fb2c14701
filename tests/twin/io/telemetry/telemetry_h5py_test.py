"""What a user of h5py sees: telemetry_h5py_test.py FILE finished|running ROWS (written by telemetry_test.cc)."""
import sys

import h5py

# Strings are bytes to h5py: they are of fixed length.
path, state, rows = sys.argv[1], sys.argv[2], int(sys.argv[3])
finished = state == "finished"

with h5py.File(path, "r") if finished else h5py.File(path, "r", swmr=True) as f:
    assert f.attrs["engine"] == b"test", dict(f.attrs)
    assert f["complete"].dtype == "uint8" and f["complete"][()] == finished, f["complete"][()]
    assert f["time_s"].shape == (rows,) and f["time_s"].attrs["unit"] == b"s"
    names = ["one", "%2F\u00fc"]
    assert sorted(k for k in f if isinstance(f[k], h5py.Group)) == sorted(names), list(f)
    groups = {k: f[k] for k in names}
    assert groups["%2F\u00fc"].attrs["name"].decode() == "/\u00fc"
    assert groups["one"].attrs["gear_ratio"] == 100 and groups["%2F\u00fc"].attrs["gear_ratio"] == 178
    for j, group in enumerate(groups.values()):
        assert sorted(group) == ["a", "b", "cycle_a"], list(group)
        for c, (name, unit, description) in enumerate((("a", b"rad", b"an angle"), ("b", b"Nm", b"a torque"))):
            d = group[name]
            assert d.shape == (rows,) and d.chunks and d.dtype == "float64", (d.shape, d.chunks, d.dtype)
            assert d.attrs["unit"] == unit and d.attrs["description"] == description and d.attrs["time"] == b"time_s"
            assert (d[:] == f["time_s"][:] + 0.25 * (2 * j + c)).all()
        assert group["cycle_a"].shape == f["cycle_time_s"].shape == (1,)
        assert group["cycle_a"].attrs["time"] == b"cycle_time_s"
