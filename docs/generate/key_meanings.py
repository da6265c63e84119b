"""What each key of a campaign file means, and the kind of quantity it takes; a key that nothing explains stops the build."""

MEANINGS: dict[str, dict[str, tuple[str, str]]] = {
    "CampaignTable": {
        "name": ("", "title of the campaign, shown in the report"),
        "seed": ("", "start of all random numbers: the same seed gives the same results, bit for bit"),
    },
    "VehicleTable": {
        "catalogue": ("", "name of a published vehicle; `seatrial vehicle` lists them"),
        "name": ("", "name of a vehicle that is described here"),
        "mass": (
            "mass",
            'dry mass; with `"unknown"` coefficients are per unit of effective mass, and `moves` may list the axes that have terms',
        ),
        "inertia": ("inertia", "moments of inertia I_xx, I_yy, I_zz about the body's origin"),
        "products": ("inertia", "products of inertia I_xy, I_yz, I_xz"),
        "centre_of_gravity": ("length", "its place forward, starboard and down of the body's origin"),
        "centre_of_buoyancy": ("length", "its place forward, starboard and down of the body's origin"),
        "weight": ("force", "weight, if it is not mass times gravity"),
        "buoyancy": ("force", "buoyancy; equal to the weight if not given"),
        "moves": (
            "",
            'velocities that are simulated: `["u"]` makes a surge model, `["v", "r"]` a steering model, `[]` a vehicle that is held',
        ),
        "given": ("", "velocities and angles that are taken from the record instead of simulated"),
        "positions": ("", "positions that are simulated too"),
        "attitude": ("", "how the attitude is simulated; quaternions also work at a pitch of 90 degrees"),
        "current": (
            "",
            "whether the velocity of the water over the earth is a state of each trial; sensors of `u_g`, `v_g`, `x` and `y` show it",
        ),
        "actuators": ("", "`published` for those of the catalogue, or a table for each control"),
        "published_to": (
            "percentage",
            "prior of each catalogue coefficient that has none of its own: normal about the published value, with this standard deviation, "
            "and cut where damping would drive the vehicle",
        ),
        "known_from": (
            "",
            "folders of earlier campaigns, after `seatrial run` or `seatrial estimate --by mode`: a coefficient they found becomes a prior "
            "if it is estimated here, else a fixed value; "
            "gains, dead zones and lags of thrusters, net weight, centre of buoyancy and drag of a tether become priors",
        ),
        "thrust_deduction": ("1", "thrust deduction t_d: share of the thrust that the hull takes back"),
        "wake": ("1", "wake fraction: share by which the water reaches the propeller more slowly"),
        "fixed": ("SI", "known coefficients, by name"),
        "trim": (
            "that of the signal",
            "steady values about which the vehicle is driven, by signal, such as `n` and `u`; "
            "thrusters, fins and side forces are at 0 where nothing is said",
        ),
        "thrusters": ("", "place and direction of each thruster, in place of those of the catalogue"),
        "thrust_laws": ("", "thrust of logged commands, by name"),
        "tether": ("", "drag of a tether at a point of the vehicle"),
        "added_coriolis": ("", "whether Coriolis forces of the added mass are terms, or follow from it"),
    },
    "ActuatorTable": {
        "lag": ("time", "time constant between command and motion of the actuator"),
        "lower": ("that of the control", "smallest command"),
        "upper": ("that of the control", "largest command"),
        "rate": ("that of the control, per second", "largest rate of change"),
    },
    "TetherTable": {
        "point": (
            "length",
            "where it is made fast, forward, starboard and down of the body's origin; the origin if not given",
        ),
        "linear": ("force per speed", "drag per m/s of the point; a guess if `[prior.tether_linear]` seeks it"),
        "quadratic": (
            "force per speed squared",
            "drag per square of the point's speed; a guess if `[prior.tether_quadratic]` seeks it",
        ),
    },
    "ThrustLawTable": {
        "curve": ("", "CSV with a header and two columns: the command, and the thrust in N"),
        "polynomial": ("", "instead of a curve: coefficients of the thrust in N, the constant first"),
        "neutral": ("", "command of no thrust, subtracted before the polynomial"),
        "dead_zone": ("", "the two commands between which there is no thrust, ends included"),
        "reverse": ("1", "factor on negative thrust"),
        "lag": (
            "time",
            "time constant by which the thrust follows the command; `[prior.lag_f]` makes it an unknown of all thrusters",
        ),
    },
    "ThrusterTable": {
        "place": ("length", "its place forward, starboard and down of the body's origin"),
        "direction": ("", "direction of positive thrust: forward, starboard, down, of any length"),
        "law": ("", "name of its law of thrust; not needed if there is only one"),
    },
    "MountTable": {
        "channels": ("", "channels of the sensor, such as u, v and w of a Doppler log"),
        "place": (
            "length",
            "its place forward, starboard and down of the body's origin; an unknown with `[prior.x_NAME]`",
        ),
        "roll": ("angle", "turn of the sensor about the body's x axis"),
        "pitch": ("angle", "turn about the y axis"),
        "yaw": ("angle", "turn about the z axis; an unknown with `[prior.yaw_NAME]`"),
        "scale": ("1", "shown value over true value; an unknown with `[prior.scale_NAME]`"),
        "late": (
            "time",
            "time by which it shows the past, such as a clock that is behind; an unknown with `[prior.late_NAME]`",
        ),
    },
    "StructureTable": {
        "always": ("", "terms that every structure has, by name"),
        "optional": ("", "terms that the data may keep or drop; all subsets are compared"),
        "rules": ("", "which terms may stand together, one rule in each line"),
        "shortlist": ("", "how many structures are simulated, if there are more than 64 and a screening has to choose"),
        "g": ("1", "g of Zellner's g-prior, which then replaces the stated priors in the screening"),
    },
    "PriorTable": {
        "distribution": ("", "form of the prior; the table above says which numbers each form needs"),
        "lower": ("SI, or `unit`", "lower bound"),
        "upper": ("SI, or `unit`", "upper bound"),
        "mean": ("SI, or `unit`", "mean of a normal"),
        "sd": ("SI, or `unit`", "standard deviation of a normal"),
        "scale": ("SI, or `unit`", "width of a half-normal: 68 % lie within it"),
        "median": ("SI, or `unit`", "median of a log-normal, with its sign"),
        "factor": ("1", "spread of a log-normal: 68 % lie within this factor of the median"),
        "unit": ("", "unit of the numbers above, if it is not SI"),
        "physical": ("", "cut the prior to the sign that a damping or an added mass has by itself"),
    },
    "SensorTable": {
        "noise": ("that of the channel", "standard deviation of one sample"),
        "rate": ("frequency", "how often it measures, if less often than the record has samples"),
        "residuals": ("", "residuals of this channel, in place of those of `[estimation]`"),
        "bias": ("", "an unknown constant error: one for all trials, or one for each"),
        "lag": ("", "whether the sensor answers late; needs `[prior.lag_CHANNEL]`"),
        "over": ("", "whether a speed is measured over ground or through the water"),
    },
    "LoopTable": {
        "moves": (
            "1",
            "controls that it moves, or set-points of loops further down, each with its share of the output",
        ),
        "kp": ("that of what it moves, over that of the channel", "proportional gain"),
        "ki": ("the same, per second", "integral gain"),
        "kd": ("the same, times seconds", "derivative gain; it acts on the measurement, not on the set-point"),
        "derivative": ("", "channel that shows the rate of change, such as `r`; without it differences are taken"),
        "set_point": ("that of the channel", "value that is held if the trial does not move it; its trim if not given"),
        "limit": ("that of what it moves", "largest output, to either side"),
        "rate": ("that of what it moves, per second", "fastest change of the output"),
        "interval": (
            "time",
            "from one decision to the next, a multiple of `design.sample_time`, which it is if not given",
        ),
    },
    "LimitsTable": {
        "lower": ("that of the quantity", "lower bound"),
        "upper": ("that of the quantity", "upper bound"),
        "rate": ("that of the control, per second", "largest rate of change, for controls only"),
    },
    "DesignTable": {
        "control": ("", "the control that is driven"),
        "families": ("", "shapes of input to compare, from the list below"),
        "utility": ("", "what makes a design the best; see above"),
        "filter": ("", "filter that computes the entropy reduction"),
        "over": (
            "",
            "the utility is the mean over draws of the coefficients, the value at their mean (`local`), or the worst",
        ),
        "per": ("", "whether a trial counts as a whole, by the energy it takes, or by the time"),
        "turnaround": ("time", 'time between trials, counted with `per = "second"`'),
        "probability": ("1", "probability with which the limits of the motion must be kept"),
        "trim": ("that of the control", "value about which the control is driven; if not given, that of `[vehicle]`"),
        "duration": ("time", "length of the trial"),
        "active": ("time", "how long the control may leave trim"),
        "start": ("time", "time at trim before the control moves"),
        "ramp": ("time", "time that each change of level takes"),
        "sample_time": ("time", "time between samples"),
        "together": (
            "that of each control",
            "other controls that move at the same time, by name, each with its largest amplitude",
        ),
        "schedule": ("", "CSV of a schedule of your own, which is compared with the designs and run first"),
        "amplitude": ("that of the control", "amplitudes that are compared"),
        "period": ("time", "periods that are compared; the list of shapes says what the period of each is"),
        "relay": ("", "the self-oscillating test, `[design.relay]`"),
        "prediction": ("", "what `fisher-c` minimises, `[design.prediction]`"),
    },
    "RangeTable": {
        "from": ("that of the quantity", "first value"),
        "to": ("that of the quantity", "last value"),
        "points": ("", "number of values, evenly spaced"),
    },
    "RelayTable": {
        "output": ("", "measured state that reverses the control"),
        "threshold": ("that of the output", "distances from trim that are tried"),
    },
    "BesideTable": {
        "amplitude": ("that of the control", "its amplitude at the largest amplitude of the designed control"),
        "period": ("1", "its period over that of the designed control"),
    },
    "PredictionTable": {
        "of": ("", "what is predicted: a state, `distance` or `advance`"),
        "control": ("that of the control", "value to which the control is set"),
        "after": ("time", "how long after that"),
    },
    "PowerTable": {
        "hotel": ("power", "power drawn whatever the propeller does"),
        "propulsion": ("power", "power drawn by the propeller at the operating point `at`"),
        "at": ("that of the control", "the control at which `propulsion` is drawn"),
    },
    "GoalTable": {
        "sd": ("that of the coefficient, or percentage", "standard deviation wanted of each coefficient"),
        "decided": ("", "whether one structure must hold 95 % of the probability"),
        "trials": ("", "most trials to run"),
    },
    "PlanTable": {
        "time": ("time", "time on the water, all trials with their turnaround"),
        "battery": ("energy", "energy for all trials, by [power]"),
        "turnaround": ("time", "time between trials, such as the way back"),
        "chance": ("1", "chance of meeting all goals from which on no trial is added"),
    },
    "ImportTable": {
        "fit": ("", "labels of the runs that are fitted jointly"),
        "predict": ("", "labels of the runs that are only predicted"),
        "step": (
            "time",
            "grid on which samples are averaged, for logs of many samples; if not given, every stamp is kept",
        ),
        "start": ("time", "cut off what comes before this"),
        "end": ("time", "cut off what comes after this"),
        "trim": ("", "`[import.trim.RUN]`, for a run with its own start and end"),
        "split": ("time", "length of the pieces into which a long record is cut"),
        "schedule": ("", "CSV of what was commanded, with `{run}` for the label of a run; the record is cut to it"),
        "keep": ("", "conditions that a run must meet, `[[import.keep]]`; it is cut to the longest such stretch"),
        "files": ("", "the logs, `[[import.files]]`, one or more"),
    },
    "KeepTable": {
        "path": ("", "path of a log of the trial; `{run}` stands for the label of a run"),
        "when": ("", "comparisons of columns with numbers, joined by `and`, such as `armed == 1 and voltage > 14.5`"),
        "table": ("", "topic or type of message, if the log has several"),
        "time": ("", "column of time, `[import.keep.time]`; not needed if the format has a clock of its own"),
        "delimiter": ("", "character between the cells of a text file, or `whitespace`"),
    },
    "FileTable": {
        "path": ("", "path of the log; `{run}` stands for the label of a run, `${NAME}` for an environment variable"),
        "table": ("", "topic, type of message, struct or variable, if the log has several"),
        "time": ("", "column of time, `[import.files.time]`"),
        "channels": ("", "columns of the channels, `[import.files.channels.CHANNEL]`"),
        "runs": (
            "",
            "the runs that have this log, if its columns or its name are not those of every run; all without it",
        ),
        "clock": ("", "use the stamps as they are, spread them evenly, or drop rows that repeat one"),
        "shift": (
            "time",
            "added to the stamps of this log, if its clock differs from that of the others; not for `seatrial live`",
        ),
        "delimiter": ("", "character between the cells of a text file, or `whitespace`"),
        "encoding": ("", "encoding of a text file"),
        "skip_rows": ("", "lines above the header of a text file"),
        "header_rows": ("", "rows of the header of a text file; the first names the columns"),
        "names": (
            "",
            "names of all columns, for a text file without a header; if not given, `column_1`, `column_2`, …",
        ),
        "axes": ("", "axes of the log: `NED` with body axes forward, right, down, or `ENU` with forward, left, up"),
    },
    "TrimTable": {
        "start": ("time", "where the run begins, counted from the beginning of the record"),
        "end": ("time", "where the run ends, counted in the same way"),
    },
    "TimeTable": {
        "column": ("", "name of the column of time"),
        "unit": ("time", "its unit; not needed if the log states it"),
    },
    "ColumnTable": {
        "column": ("", "name of the column of the channel"),
        "unit": ("that of the channel", "unit of the column"),
        "scale": ("1", "factor on the column; -1 turns an axis round"),
        "offset": (
            "that of the channel",
            "constant added after scaling; before a law of thrust, in units of the command",
        ),
        "sum": ("", "instead of a column: columns with factors, such as `0.12 data[0] - 0.12 data[1]`"),
        "curve": (
            "",
            "CSV that says what each logged number stands for, such as the thrust of a PWM width; it has to reach the rows that are kept",
        ),
        "between": (
            "",
            "of a control: `held` from sample to sample, as a command is, or a straight `line`, as of a measured propeller",
        ),
    },
    "FilterTable": {
        "process_noise": (
            "SI, or a quantity",
            "standard deviation that each state or coefficient gains in one second, by name",
        ),
    },
    "EstimationTable": {
        "likelihood": ("", "where the misfit comes from: [which likelihood?](../likelihoods.md)"),
        "initial": (
            "",
            "how each trial begins: at trim, at the first measurement, or at unknown values that are estimated",
        ),
        "residuals": ("", "what the noise is like: [which likelihood?](../likelihoods.md)"),
        "current": ("", "an unknown steady current along the course: one for all trials, or one for each"),
        "varying": ("", "coefficients that differ from trial to trial"),
        "sampler": ("", "how the posterior is sampled: [the samplers](../explanation/samplers.md)"),
        "chains": ("", "number of chains"),
        "warmup": ("", "draws at the start of each chain that are discarded"),
        "draws": (
            "",
            "draws of each chain after that; twice or four times as many while chains disagree or have too few effective draws",
        ),
        "thin": ("", "keep one draw in so many"),
    },
    "ChecksTable": {"accept": ("", "codes of findings that are accepted, such as `clock-shift`")},
    "ComputeTable": {
        "workers": (
            "",
            "where the work is done: `local`, `slurm`, or the address of a Dask scheduler such as `tcp://10.0.0.1:8786`",
        ),
        "slurm": ("", "resources of each job, `[compute.slurm]`"),
    },
    "SlurmTable": {
        "memory": ("memory", "memory of each job, such as `4 GB`"),
        "walltime": ("time", "time limit of each job, as SLURM writes it"),
        "cores": ("", "cores of each job, one worker on each"),
        "jobs": ("", "number of jobs"),
        "queue": ("", "partition to submit to"),
        "account": ("", "account to charge"),
        "interface": ("", "network interface of the workers"),
    },
    "SelectionTable": {
        "particles": (
            "",
            "particles of the tempered SMC that checks each evidence; if not given, 512, or 64 for each parameter where that is more",
        ),
        "repeats": ("", "independent repeats of it"),
        "draws": ("", "draws of the importance sampling that gives each evidence"),
    },
}
"""By table of the schema and key: kind of quantity, meaning."""
