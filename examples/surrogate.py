"""Train a network on the map of linkages that predicts cost of transport and slip from lengths.

Run the example as follows:

    python examples/surrogate.py [EPOCHS]

EPOCHS is the number of epochs, 30 by default.

The example prints the scores of the network on the test split of the map. For comparison, it also
prints the scores of a predictor that returns the values of the nearest linkage in the training
split.
"""

import sys

import numpy as np
import torch
from linkage_map import NAMES, is_test, load
from torch import nn

epochs = int(sys.argv[1]) if len(sys.argv) > 1 else 30
torch.manual_seed(0)
data = load()
test = torch.tensor(is_test(data))
x = torch.tensor(np.stack([data[name] for name in NAMES], axis=1)).float()
y = torch.tensor(np.log([data["cost"], np.fmax(data["slip"], 1e-3)]).T).float()
x = (x - x[~test].mean(0)) / x[~test].std(0)
middle, spread = y[~test].mean(0), y[~test].std(0)
train_x, train_y = x[~test], (y[~test] - middle) / spread

net = nn.Sequential(
    nn.Linear(x.shape[1], 256),
    nn.SiLU(),
    nn.Linear(256, 256),
    nn.SiLU(),
    nn.Linear(256, y.shape[1]),
)
optimizer = torch.optim.Adam(net.parameters(), 2e-3)
steps = epochs * (-(-len(train_x) // 512))
schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
for _ in range(epochs):
    for batch in torch.randperm(len(train_x)).split(512):
        optimizer.zero_grad()
        nn.functional.mse_loss(net(train_x[batch]), train_y[batch]).backward()
        optimizer.step()
        schedule.step()

with torch.no_grad():
    nearest = torch.cat([torch.cdist(part, train_x).argmin(1) for part in x[test].split(500)])
    guesses = {"network": middle + spread * net(x[test]), "nearest": y[~test][nearest]}
print(f"{len(train_x)} linkages to train, {int(test.sum())} to test")
for name, guess in guesses.items():
    error = guess - y[test]
    r2 = 1.0 - (error**2).mean(0) / y[test].var(0)
    off = 100.0 * (error.abs().median(0).values.exp() - 1.0)
    print(
        f"{name}: R2 of log cost {r2[0]:.3f}, of log slip {r2[1]:.3f}; "
        f"median error of cost {off[0]:.1f} %, of slip {off[1]:.1f} %"
    )
