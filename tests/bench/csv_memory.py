"""Peak memory of `tribotwin identify` on friction curves of many rows. Arguments: the program, rows (10^7 without)."""
import os, resource, subprocess, sys, tempfile

program = sys.argv[1]
rows = int(float(sys.argv[2])) if len(sys.argv) > 2 else 10**7
with tempfile.NamedTemporaryFile('w', suffix='.csv', dir=os.getcwd()) as f:
    f.write('speed_rad_s,friction_norm\n')
    for i in range(rows):
        speed = 1 + 279 * (i % 1000) / 999
        f.write(f'{speed:.6g},{0.034 + 0.046 * 2.718281828 ** -((speed / 10.68) ** 1.93) + 3.68e-4 * speed:.6g}\n')
    f.flush()
    subprocess.run([program, 'identify', '--law', 'stribeck', f.name], check=True, stdout=subprocess.DEVNULL)
peak_kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
print(f'{rows} rows: {peak_kib / 2**20:.2f} GiB')
