"""ONNX graphs of models, from features to calibrated probabilities."""

from __future__ import annotations

import json
from types import ModuleType
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.classify.learned import Constant, Ensemble, Kernel, Learned, Linear, Network, TrackNetwork, Trees
from doppelgait.classify.model import Model
from doppelgait.core.errors import ConfigError

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
    log_probability = graph.calibrated(
        graph.member(model.learned, "model"), model.calibration.slope, model.calibration.shift, "calibration"
    )
    graph.add("Cast", [graph.add("Exp", [log_probability])], out=PROBABILITY, to=onnx.TensorProto.FLOAT)
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

    def add(self, kind: str, inputs: list[str], out: str | None = None, **attributes: Any) -> str:
        """Add a node and return the name of its output."""
        out = out or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(kind, inputs, [out], name=f"make_{out}", **attributes))
        return out

    def add_constant(self, values: Any, name: str, dtype: Any = np.float64) -> str:
        """Add a constant array and return its name."""
        name = f"{name}_{len(self.constants)}"
        self.constants.append(self.onnx.numpy_helper.from_array(np.ascontiguousarray(values, dtype=dtype), name))
        return name

    def combine(self, kind: str, value: str, constant: Any, name: str, dtype: Any = np.float64) -> str:
        """Add a node of a value and a constant."""
        return self.add(kind, [value, self.add_constant(constant, name, dtype)])

    def member(self, learned: Learned, name: str) -> str:
        """Add a trained model; return its log-probabilities in double precision."""
        match learned:
            case Constant():
                return self.shares(learned, name)
            case Linear():
                return self.add_scores(self.add_standardisation(learned, name), learned.weight, learned.bias, name)
            case Kernel():
                return self.kernel(learned, name)
            case Trees():
                return self.add_trees(learned, name)
            case Network():
                return self.add_network(learned, name)
            case Ensemble():
                return self.add_ensemble(learned, name)
            case TrackNetwork():
                raise ConfigError("an ONNX graph has no memory of tracks")

    def calibrated(self, log_probability: str, slope: float, shift: Any, name: str) -> str:
        scaled = self.combine("Mul", log_probability, slope, f"{name}_slope")
        return self.add("LogSoftmax", [self.combine("Add", scaled, shift, f"{name}_shift")], axis=1)

    def features(self) -> str:
        if not self.model.facts.names:
            raise ConfigError(f"the model {self.model.facts.name} has no inputs; there is nothing to export")
        self.inputs[FEATURES] = ["n", len(self.model.facts.names)]
        return FEATURES

    def shares(self, learned: Constant, name: str) -> str:
        used = self.features()
        ends = [self.add_constant([k], "at", np.int64) for k in (0, 1)]
        count = self.add("Slice", [self.add("Shape", [used]), *ends])
        shape = self.add("Concat", [count, self.add_constant([learned.log_share.size], "classes", np.int64)], axis=0)
        return self.add("Expand", [self.add_constant(learned.log_share, name), shape])

    def add_ensemble(self, learned: Ensemble, name: str) -> str:
        parts = []
        joined = zip(learned.members, learned.weights, learned.slopes, learned.shifts, strict=True)
        for number, (member, weight, slope, shift) in enumerate(joined):
            own = f"{name}_{number}"
            answer = self.calibrated(self.member(member, own), slope, shift, own)
            parts.append(self.combine("Mul", answer, weight, f"{own}_weight"))
        return self.add("LogSoftmax", [self.add("Sum", parts)], axis=1)

    def add_standardisation(self, learned: Linear | Kernel, name: str) -> str:
        double = self.onnx.TensorProto.DOUBLE
        values = self.doubles = self.doubles or self.add("Cast", [self.features()], to=double)
        unknown = self.add("IsNaN", [values])
        filled = values
        if learned.floor.size:
            has = learned.floor > 0
            raised = self.combine("Max", values, np.where(has, learned.floor, 1.0), f"{name}_floor")
            log = self.add("Log", [raised])
            filled = self.add("Where", [self.add_constant(has, f"{name}_has_floor", np.bool_), log, values])
        columns = self.add("Where", [unknown, self.add_constant(learned.median, f"{name}_median"), filled])
        if learned.told.size:
            told = self.add("Gather", [unknown, self.add_constant(learned.told, f"{name}_told", np.int64)], axis=1)
            columns = self.add("Concat", [columns, self.add("Cast", [told], to=double)], axis=1)
        centred = self.combine("Sub", columns, learned.mean, f"{name}_mean")
        return self.combine("Div", centred, learned.scale, f"{name}_scale")

    def add_scores(self, columns: str, weight: Any, bias: Any, name: str) -> str:
        product = self.combine("MatMul", columns, weight.T, f"{name}_weight")
        return self.add_log_softmax(self.combine("Add", product, bias, f"{name}_bias"), len(bias))

    def add_log_softmax(self, scores: str, n_scores: int) -> str:
        """Normalise scores; one score means two classes."""
        if n_scores == 1:
            zero = self.combine("Mul", scores, 0.0, "zero")
            scores = self.add("Concat", [zero, scores], axis=1)
        return self.add("LogSoftmax", [scores], axis=1)

    def kernel(self, learned: Kernel, name: str) -> str:
        rows = self.add_standardisation(learned, name)
        norm = self.add_constant((learned.support**2).sum(axis=1), f"{name}_norm")
        own = self.add("ReduceSumSquare", [rows, self.add_constant([1], "axis", np.int64)], keepdims=1)
        product = self.add("MatMul", [rows, self.add_constant(-2.0 * learned.support.T, f"{name}_support")])
        squared = self.add("Relu", [self.add("Sum", [own, norm, product])])
        near = self.add("Exp", [self.add("Neg", [squared])])
        return self.add_scores(near, learned.weight, learned.bias, name)

    def add_trees(self, learned: Trees, name: str) -> str:
        """Add boosted trees, each reached from its root."""
        modes, rows, thresholds = [], [], []
        leaves: dict[str, list[Any]] = {"treeids": [], "nodeids": [], "ids": [], "weights": []}
        for tree, root in enumerate(learned.root.ravel().tolist()):
            order = list_nodes(learned, root)
            place = {node: number for number, node in enumerate(order)}
            thresholds += learned.threshold[order].tolist()
            for node in order:
                modes.append("BRANCH_LEQ" if learned.feature[node] >= 0 else "LEAF")
                left, right = (place.get(child[node], 0) for child in (learned.left, learned.right))
                rows.append((tree, place[node], max(learned.feature[node], 0), left, right, learned.unknown_left[node]))
                if learned.feature[node] < 0:
                    leaf = (tree, place[node], tree % learned.root.shape[1], learned.value[node])
                    for key, value in zip(leaves, leaf, strict=True):
                        leaves[key].append(value)
        integers = np.array(rows, dtype=np.int64).T.tolist()
        names = ("treeids", "nodeids", "featureids", "truenodeids", "falsenodeids", "missing_value_tracks_true")
        attributes = {f"nodes_{key}": values for key, values in zip(names, integers, strict=True)}
        attributes |= {f"target_{key}": values for key, values in leaves.items()}
        scores = self.add(
            "TreeEnsembleRegressor",
            [self.features()],
            domain="ai.onnx.ml",
            aggregate_function="SUM",
            n_targets=learned.root.shape[1],
            nodes_modes=modes,
            post_transform="NONE",
            base_values=learned.start.astype(np.float32).tolist(),
            nodes_values=round_threshold(thresholds).tolist(),
            **attributes,
        )
        scores = self.add("Cast", [scores], to=self.onnx.TensorProto.DOUBLE)
        return self.add_log_softmax(scores, learned.root.shape[1])

    def add_network(self, learned: Network, name: str) -> str:
        """Add a network, averaged over pictures and mirror images."""
        spec, n_classes = learned.patch, learned.bias.size
        pictures, self.inputs[PICTURES] = PICTURES, ["n", "m", spec.n_velocity, spec.n_time]
        shape = self.add_constant([-1, 1, spec.n_velocity, spec.n_time], "shape", np.int64)
        flat = self.add("Reshape", [pictures, shape])
        flip = [self.add_constant([value], "flip", np.int64) for value in (-1, -(2**62), 2, -1)]
        mirrored = self.add("Slice", [flat, *flip])
        layer = self.add("Concat", [flat, mirrored], axis=0)
        layers = zip(learned.kernels, learned.scales, learned.biases, strict=True)
        for number, (kernel, scale, bias) in enumerate(layers):
            weights = self.add_constant(kernel, f"{name}_kernel_{number}", np.float32)
            layer = self.add("Conv", [layer, weights], kernel_shape=[3, 3], pads=[1, 1, 1, 1])
            layer = self.add("MaxPool", [layer], kernel_shape=[2, 2], strides=[2, 2])
            for kind, values in (("Mul", scale), ("Add", bias)):
                layer = self.combine(kind, layer, values[:, None, None], f"{name}_{number}", np.float32)
            layer = self.add("Relu", [layer])
        mean = self.combine("Reshape", self.add("GlobalAveragePool", [layer]), [0, -1], "shape", np.int64)
        product = self.combine("MatMul", mean, learned.weight.T, f"{name}_weight", np.float32)
        scores = self.combine("Add", product, learned.bias, f"{name}_bias", np.float32)
        double = self.add("Cast", [scores], to=self.onnx.TensorProto.DOUBLE)
        answers = self.add("LogSoftmax", [double], axis=1)
        # (2, n, m, classes): the mean over mirror images and pictures
        ends = [self.add_constant([k], "at", np.int64) for k in (0, 2)]
        leading = self.add("Slice", [self.add("Shape", [pictures]), *ends])
        parts = [self.add_constant([2], "two", np.int64), leading, self.add_constant([n_classes], "classes", np.int64)]
        split = self.add("Reshape", [answers, self.add("Concat", parts, axis=0)])
        found = self.add("ReduceMean", [split, self.add_constant([0, 2], "axes", np.int64)], keepdims=0)
        total = self.add("ReduceSum", [pictures, self.add_constant([1, 2, 3], "axes", np.int64)], keepdims=0)
        unknown = self.add("Unsqueeze", [self.add("IsNaN", [total]), self.add_constant([1], "axes", np.int64)])
        return self.add("LogSoftmax", [self.add("Where", [unknown, self.add_constant(0.0, "equal"), found])], axis=1)

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


def list_nodes(learned: Trees, root: int) -> list[int]:
    """Return a tree's nodes, parents first, left before right."""
    stack, order = [root], []
    while stack:
        node = stack.pop()
        order.append(node)
        if learned.feature[node] >= 0:
            stack += [int(learned.right[node]), int(learned.left[node])]
    return order
