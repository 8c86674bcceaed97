"""Wrong calls: each must be an error to mypy and to pyright, as an ignore too many is one."""

from jansen_env.tasks.crank import JansenCrankEnv, JansenCrankVectorEnv
from jansen_env.tasks.goal import JansenGoalEnv, JansenGoalVectorEnv
from jansen_env.tasks.walking import (
    JansenWalkerBuiltEnv,
    JansenWalkerBuiltVectorEnv,
    JansenWalkerEnv,
    JansenWalkerHardcoreEnv,
    JansenWalkerHardcoreVectorEnv,
    JansenWalkerRoughEnv,
    JansenWalkerRoughVectorEnv,
    JansenWalkerVectorEnv,
)

JansenWalkerEnv(frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerEnv(friction="x")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
JansenWalkerEnv(threads=2)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerEnv(tracking_weight=1.0)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerBuiltEnv(frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerRoughEnv(frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerHardcoreEnv(frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenCrankEnv(friction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenCrankEnv(delay="x")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
JansenGoalEnv(speed_command=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenGoalEnv(friction="x")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]

JansenWalkerVectorEnv(2, frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerVectorEnv(2, friction="x")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
JansenWalkerVectorEnv(2, friction=["x", "y"])  # type: ignore[list-item]  # pyright: ignore[reportArgumentType]
JansenWalkerBuiltVectorEnv(2, frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerRoughVectorEnv(2, frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenWalkerHardcoreVectorEnv(2, frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenCrankVectorEnv(2, frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenCrankVectorEnv(2, delay="x")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
JansenGoalVectorEnv(2, frction=0.5)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
JansenGoalVectorEnv(2, friction="x")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
JansenGoalVectorEnv("2")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
