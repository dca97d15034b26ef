"""ONNX graphs of models, from features to calibrated probabilities."""

from __future__ import annotations

import json
from types import ModuleType
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.classify.learned import LAYERS, Learned
from doppelgait.classify.model import Model
from doppelgait.classify.scorer import Arrays
from doppelgait.core.errors import ConfigError
from doppelgait.processing.patches import Patch

NO_ONNX = "onnx is not installed, which the form onnx needs: pip install 'doppelgait[export]'"
OPSET, TREES_OPSET, IR_VERSION = 18, 3, 9
"""Versions of the format from 2022 and 2023, which older runtimes can read."""
FEATURES, PICTURES, PROBABILITY = "features", "pictures", "probability"


def build_onnx_model(model: Model) -> Any:
    """Build the ONNX graph of a model."""
    try:
        import onnx
    except ImportError:
        raise ConfigError(NO_ONNX) from None
    graph = _Graph(onnx, model)
    answers = graph.add_calibration(graph.add_member(model.learned), model.calibration.slope, model.calibration.shift)
    graph.add("Cast", graph.add("Exp", answers), out=PROBABILITY, to=onnx.TensorProto.FLOAT)
    return graph.finish()


def round_threshold(threshold: Any) -> Any:
    """Round thresholds of trees down to float32."""
    # every float32 value then takes the same branch as in double precision
    rounded = np.asarray(threshold, dtype=np.float64).astype(np.float32)
    return np.where(rounded > threshold, np.nextafter(rounded, np.float32(-np.inf)), rounded).astype(np.float32)


class _Graph:
    def __init__(self, onnx: ModuleType, model: Model) -> None:
        self.onnx, self.model = onnx, model
        self.nodes: list[Any] = []
        self.constants: list[Any] = []
        self.inputs: dict[str, list[int | str]] = {}
        self.doubles: str | None = None

    def add(self, kind: str, *inputs: Any, out: str | None = None, single: bool = False, **attributes: Any) -> str:
        """Add a node of named values and of constants, in single or double precision; return its output."""
        out = out or f"{kind.lower()}_{len(self.nodes)}"
        names = [each if isinstance(each, str) else self.add_constant(each, single) for each in inputs]
        self.nodes.append(self.onnx.helper.make_node(kind, names, [out], name=f"make_{out}", **attributes))
        return out

    def add_constant(self, values: Any, single: bool) -> str:
        """Add a constant array and return its name."""
        array, name = np.ascontiguousarray(values), f"constant_{len(self.constants)}"
        dtypes = {"f": np.float32 if single else np.float64, "i": np.int64, "b": np.bool_}
        self.constants.append(self.onnx.numpy_helper.from_array(array.astype(dtypes[array.dtype.kind]), name))
        return name

    def add_member(self, learned: Learned) -> str:
        """Add a trained model; return its log-probabilities in double precision."""
        own = learned.arrays
        match learned.kind:
            case "constant":
                count = self.add("Slice", self.add("Shape", self.add_features()), [0], [1])
                shares = own["log_share"]
                return self.add("Expand", shares, self.add("Concat", count, [shares.size], axis=0))
            case "linear":
                return self.add_linear(own)
            case "trees":
                return self.add_trees(own)
            case "network":
                return self.add_network(learned)
            case "ensemble":
                parts = zip(learned.members, own["weights"], own["slopes"], own["shifts"], strict=True)
                answers = [
                    self.add("Mul", self.add_calibration(self.add_member(member), slope, shift), weight)
                    for member, weight, slope, shift in parts
                ]
                return self.add("LogSoftmax", self.add("Sum", *answers), axis=1)
        raise ConfigError("an ONNX graph has no memory of tracks")

    def add_calibration(self, log_probability: str, slope: float, shift: Any) -> str:
        return self.add("LogSoftmax", self.add("Add", self.add("Mul", log_probability, slope), shift), axis=1)

    def add_features(self) -> str:
        if not self.model.facts.names:
            raise ConfigError(f"the model {self.model.facts.name} has no inputs; there is nothing to export")
        self.inputs[FEATURES] = ["n", len(self.model.facts.names)]
        return FEATURES

    def add_linear(self, own: Arrays) -> str:
        double = self.onnx.TensorProto.DOUBLE
        filled = values = self.doubles = self.doubles or self.add("Cast", self.add_features(), to=double)
        unknown = self.add("IsNaN", values)
        has = own["floor"] > 0
        log = self.add("Log", self.add("Max", values, np.where(has, own["floor"], 1.0)))
        filled = self.add("Where", has, log, values)
        columns = self.add("Where", unknown, own["median"], filled)
        if own["told"].size:
            told = self.add("Gather", unknown, own["told"], axis=1)
            columns = self.add("Concat", columns, self.add("Cast", told, to=double), axis=1)
        columns = self.add("Div", self.add("Sub", columns, own["mean"]), own["scale"])
        product = self.add("MatMul", columns, own["weight"].T)
        return self.add_log_softmax(self.add("Add", product, own["bias"]), len(own["bias"]))

    def add_log_softmax(self, scores: str, n_scores: int) -> str:
        """Normalise scores; one score means two classes."""
        if n_scores == 1:
            scores = self.add("Concat", self.add("Mul", scores, 0.0), scores, axis=1)
        return self.add("LogSoftmax", scores, axis=1)

    def add_trees(self, own: Arrays) -> str:
        """Add boosted trees, each reached from its root."""
        modes, rows, thresholds = [], [], []
        leaves: dict[str, list[Any]] = {"treeids": [], "nodeids": [], "ids": [], "weights": []}
        for tree, root in enumerate(own["root"].ravel().tolist()):
            order = list_nodes(own, root)
            place = {node: number for number, node in enumerate(order)}
            thresholds += own["threshold"][order].tolist()
            for node in order:
                modes.append("BRANCH_LEQ" if own["feature"][node] >= 0 else "LEAF")
                left, right = (place.get(child[node], 0) for child in (own["left"], own["right"]))
                rows.append((tree, place[node], max(own["feature"][node], 0), left, right, own["unknown_left"][node]))
                if own["feature"][node] < 0:
                    leaf = (tree, place[node], tree % own["root"].shape[1], own["value"][node])
                    for key, value in zip(leaves, leaf, strict=True):
                        leaves[key].append(value)
        integers = np.array(rows, dtype=np.int64).T.tolist()
        names = ("treeids", "nodeids", "featureids", "truenodeids", "falsenodeids", "missing_value_tracks_true")
        attributes = {f"nodes_{key}": values for key, values in zip(names, integers, strict=True)}
        attributes |= {f"target_{key}": values for key, values in leaves.items()}
        scores = self.add(
            "TreeEnsembleRegressor",
            self.add_features(),
            domain="ai.onnx.ml",
            aggregate_function="SUM",
            n_targets=own["root"].shape[1],
            nodes_modes=modes,
            post_transform="NONE",
            base_values=own["start"].astype(np.float32).tolist(),
            nodes_values=round_threshold(thresholds).tolist(),
            **attributes,
        )
        scores = self.add("Cast", scores, to=self.onnx.TensorProto.DOUBLE)
        return self.add_log_softmax(scores, own["root"].shape[1])

    def add_network(self, learned: Learned) -> str:
        """Add a network, averaged over pictures and mirror images."""
        own, spec = learned.arrays, learned.patch or Patch()
        self.inputs[PICTURES] = ["n", "m", spec.n_velocity, spec.n_time]
        flat = self.add("Reshape", PICTURES, [-1, 1, spec.n_velocity, spec.n_time])
        layer = self.add("Concat", flat, self.add("Slice", flat, [-1], [-(2**62)], [2], [-1]), axis=0)
        for n in range(sum(name.startswith("kernel.") for name in own)):
            kernel, scale, bias = (own[f"{name}.{n}"] for name in LAYERS)
            layer = self.add("Conv", layer, kernel, single=True, kernel_shape=[3, 3], pads=[1, 1, 1, 1])
            layer = self.add("MaxPool", layer, kernel_shape=[2, 2], strides=[2, 2])
            layer = self.add("Mul", layer, scale[:, None, None], single=True)
            layer = self.add("Relu", self.add("Add", layer, bias[:, None, None], single=True))
        mean = self.add("Reshape", self.add("GlobalAveragePool", layer), [0, -1])
        product = self.add("MatMul", mean, own["weight"].T, single=True)
        scores = self.add("Add", product, own["bias"], single=True)
        answers = self.add("LogSoftmax", self.add("Cast", scores, to=self.onnx.TensorProto.DOUBLE), axis=1)
        # (2, n, m, classes): the mean over mirror images and pictures
        leading = self.add("Slice", self.add("Shape", PICTURES), [0], [2])
        split = self.add("Reshape", answers, self.add("Concat", [2], leading, [own["bias"].size], axis=0))
        found = self.add("ReduceMean", split, [0, 2], keepdims=0)
        total = self.add("ReduceSum", PICTURES, [1, 2, 3], keepdims=0)
        unknown = self.add("Unsqueeze", self.add("IsNaN", total), [1])
        return self.add("LogSoftmax", self.add("Where", unknown, 0.0, found), axis=1)

    def finish(self) -> Any:
        helper, single = self.onnx.helper, self.onnx.TensorProto.FLOAT
        inputs = [helper.make_tensor_value_info(name, single, shape) for name, shape in self.inputs.items()]
        output = helper.make_tensor_value_info(PROBABILITY, single, ["n", len(self.model.facts.classes)])
        graph = helper.make_graph(self.nodes, "doppelgait", inputs, [output], self.constants)
        opsets = [helper.make_opsetid("", OPSET), helper.make_opsetid("ai.onnx.ml", TREES_OPSET)]
        made = helper.make_model(
            graph, opset_imports=opsets, ir_version=IR_VERSION, producer_name="doppelgait", producer_version=__version__
        )
        facts = self.model.facts.model_dump(mode="json")
        helper.set_model_props(made, {"doppelgait": json.dumps(facts, sort_keys=True)})
        self.onnx.checker.check_model(made, full_check=True)
        return made


def list_nodes(own: Arrays, root: int) -> list[int]:
    """Return a tree's nodes, parents first, left before right."""
    stack, order = [root], []
    while stack:
        node = stack.pop()
        order.append(node)
        if own["feature"][node] >= 0:
            stack += [int(own["right"][node]), int(own["left"][node])]
    return order
