"""The control group of the laboratory: what is written where, in both versions. The kernel is a folder of files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.gateway_lab.control_group import ControlGroup, NoControlGroup


def written(root: Path) -> dict[str, str]:
    return {
        str(file.relative_to(root)).replace(next(iter(root.rglob("barewire-*"))).name, "NAME"): file.read_text().strip()
        for file in root.rglob("*")
        if file.is_file() and "barewire-" in str(file)
    }


def test_version_1(tmp_path: Path) -> None:
    for name in ("memory", "cpu"):
        (tmp_path / name).mkdir()
    with ControlGroup(64, 0.2, root=tmp_path) as group:
        memory = {name: str(64 << 20) for name in ("memory.limit_in_bytes", "memory.memsw.limit_in_bytes")}
        cpu = {"cpu.cfs_period_us": "100000", "cpu.cfs_quota_us": "20000"}
        expected = {f"{name.partition('.')[0]}/NAME/{name}": value for name, value in (memory | cpu).items()}
        assert written(tmp_path) == expected
        (group.folders[0] / "memory.max_usage_in_bytes").write_text("3145728")
        (group.folders[0] / "memory.oom_control").write_text("oom_kill_disable 0\nunder_oom 0\noom_kill 2\n")
        (group.folders[1] / "cpu.stat").write_text("nr_periods 10\nnr_throttled 5\nthrottled_time 7\n")
        assert (group.peak, group.killed, group.throttled) == (3.0, 2, 0.5)
        clear(group)
    assert not any(folder.exists() for folder in group.folders)


def test_version_2(tmp_path: Path) -> None:
    (tmp_path / "cgroup.controllers").write_text("cpuset cpu io memory pids\n")
    with ControlGroup(64, 0.2, root=tmp_path) as group:
        values = {"memory.max": str(64 << 20), "memory.swap.max": "0", "cpu.max": "20000 100000"}
        assert written(tmp_path) == {f"NAME/{name}": value for name, value in values.items()}
        assert (tmp_path / "cgroup.subtree_control").read_text() == "+memory +cpu"
        (group.folders[0] / "memory.peak").write_text("1048576")
        (group.folders[0] / "memory.events").write_text("low 0\nhigh 0\nmax 3\noom 1\noom_kill 1\n")
        assert (group.peak, group.killed) == (1.0, 1)
        clear(group)


def clear(group: ControlGroup) -> None:
    """Remove the files: those of a real group vanish with its folder."""
    for folder in group.folders:
        for file in folder.iterdir():
            file.unlink()


@pytest.mark.parametrize(
    ("files", "text"),
    [({}, "has no control groups for memory and cpu"), ({"cgroup.controllers": "cpu io"}, "no controller for memory")],
)
def test_what_is_needed_is_said(tmp_path: Path, files: dict[str, str], text: str) -> None:
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    with pytest.raises(NoControlGroup, match=text), ControlGroup(64, 0.2, root=tmp_path):
        pass
