# For the guest kernel: systemd as the first process of a namespace, on a copy of the host's root in memory. The gateway is
# installed as docs/how-to/gateway.md says, with the packages in $PACKAGES; then `try.service` uses the unit.
set -eu
root=/run/root
mkdir -p $root /run/layer
mount -t tmpfs tmpfs /run/layer
mkdir /run/layer/upper /run/layer/work
busybox insmod "$(find /usr/lib/uml/modules -name overlay.ko)"
mount -t overlay overlay -o lowerdir=/,upperdir=/run/layer/upper,workdir=/run/layer/work $root
here=$PWD

/usr/bin/python3 -m venv --without-pip $root/opt/barewire
cp -r $PACKAGES/* $root/opt/barewire/lib/python3*/site-packages/
chroot $root /usr/sbin/useradd --system --shell /usr/sbin/nologin barewire
mkdir -p $root/etc/barewire $root/old
rm -rf $root/lib/systemd/system/*.target.wants $root/etc/systemd/system/*.wants # nothing else is started
install -m 644 packaging/barewire-gateway.service $root/etc/systemd/system/
cat >$root/etc/systemd/system/try.service <<END
[Unit]
DefaultDependencies=no
[Service]
Type=oneshot
ExecStart=/opt/barewire/bin/python $here/tests/interop/systemd_use.py
StandardOutput=file:/run/try.out
StandardError=file:/run/try.out
END

unshare --pid --mount --fork sh -euc '
  mount -t proc proc $0/proc
  mount -t sysfs sys $0/sys
  mount -t cgroup2 cgroup2 $0/sys/fs/cgroup
  mount --rbind /dev $0/dev
  mount -t tmpfs tmpfs $0/run
  cd $0
  pivot_root . old # after a mere chroot, the kernel allows no user namespaces
  umount -l /old
  exec env -i container=guest SYSTEMD_LOG_TARGET=console /lib/systemd/systemd --unit=try.service
' $root </dev/null >/run/systemd.out 2>&1 &
for _ in $(seq 900); do # a guest of a busy computer takes minutes; the test ends one that takes too long
  if grep -qE '^(done|Traceback)' /proc/[0-9]*/root/run/try.out 2>/dev/null; then break; fi
  sleep 0.5
done
# Through any process that is still there: the one that wrote the file ends just now.
for out in /proc/[0-9]*/root/run/try.out; do
  if cat "$out" 2>/dev/null; then break; fi
done
tail -40 /run/systemd.out >&2
