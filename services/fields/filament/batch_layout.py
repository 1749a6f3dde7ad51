"""Layout of a batch of filaments: its size, and the rows of the working memory of a step."""

# Each part of a step is a short loop over a batch, so that vector instructions do it for several filaments at once.
# A compiler uses them only where it knows that what is written is not what is read next. That is why the numbers of
# a batch stand in few flat arrays at constant distances: those of the x axis side by side, those of y a BATCH further
# and those of z another: x of filament p at p, y at Y + p, z at Z + p.
# A batch's numbers stay in the first cache.
BATCH = 128
Y = BATCH
Z = 2 * BATCH

# Rows of the float64 working memory, by their first place; those of three axes take three rows.
POSITION = 0  # where a filament is, in cells from the corner of the grid
NORMAL = 3 * BATCH  # standard normal numbers
MOVED = 6 * BATCH  # where a filament is after the step, world frame [m]
SIGMA = 9 * BATCH  # size after the step [m]
DT = 10 * BATCH  # how long a filament moves [s]
ETA = 11 * BATCH  # standard deviation of its random displacement per axis [m]
RISE = 12 * BATCH  # upward velocity relative to the air [m/s]
REACH = 13 * BATCH  # how far it may move along each axis without a look at walls [m]
FATE = 14 * BATCH  # one of the fates below
N_WORK = 15 * BATCH

FREE = 0.0
BOUNDED = 1.0
LEFT = 2.0
