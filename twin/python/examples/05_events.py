"""What happens to a joint while it works: a fault and a payload, from Python."""

import tribotwin


def friction_nm(*events):
    """Mean friction of joint2 in the next second after 2 s of work."""
    twin = tribotwin.Twin('irb6620_warmup', {'duration_s': 4})
    twin.step(2000)
    for event in events:
        twin.happen(event)
    total = 0.0
    for _ in range(1000):
        twin.step()
        total += abs(twin.friction_nm[twin.joints.index('joint2')])
    return total / 1000


healthy = friction_nm()
wear = {'type': 'fault', 'joint': 'joint2', 'fault': 'wear', 'severity': 0.2}
for name, events in {'wear of 20 %': [wear], '100 kg more': [{'type': 'payload', 'mass_kg': 100}]}.items():
    print(f'{name}: friction x {friction_nm(*events) / healthy:.2f}')
print(len(tribotwin.faults()), 'faults that a joint may have:', ', '.join(list(tribotwin.faults())[:3]), '...')

# Prints:
# wear of 20 %: friction x 1.09
# 100 kg more: friction x 1.01
# 7 faults that a joint may have: wear, thickening, lubricant_loss ...
