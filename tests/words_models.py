"""Tiny OWLv2 and Segment Anything models whose weights are set by hand: they see red where `apple` is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

GRID = 6
"""Patches of the detector along a side; a fruit that it can see begins half a patch behind a patch's edge."""
CHANNELS = 8
WORDS = {"<pad>": 0, "<unk>": 1, "apple": 2, "pear": 3}


def write_models(folder: Path) -> Path:
    """Save both models with their processors in `detector` and `masks` below `folder`."""
    _write_detector(folder / "detector")
    _write_masker(folder / "masks")
    return folder


def write_other_models(folder: Path) -> Path:
    """Save a tiny Grounding DINO in `detector` and a tiny Segment Anything 2 in `masks`, with weights from a die."""
    import torch
    import transformers as hf

    torch.manual_seed(0)
    vocabulary = {word: k for k, word in enumerate(["[PAD]", "[UNK]", "[CLS]", "[SEP]", "apple", "ripe", ".", "?"])}
    pixels = hf.GroundingDinoImageProcessor(size={"shortest_edge": 160, "longest_edge": 200})
    tokenizer = hf.BertTokenizerFast(vocab=vocabulary)
    hf.GroundingDinoProcessor(image_processor=pixels, tokenizer=tokenizer).save_pretrained(folder / "detector")
    stages = {"depths": [1, 1, 1, 1], "num_heads": [1, 1, 2, 2], "out_features": ["stage2", "stage3", "stage4"]}
    small = {"num_hidden_layers": 1, "num_attention_heads": 2, "hidden_size": 16, "intermediate_size": 16}
    layers = {"layers": 2, "attention_heads": 2, "ffn_dim": 16}
    detector = hf.GroundingDinoConfig(
        backbone_config=hf.SwinConfig(image_size=64, embed_dim=8, window_size=2, **stages),
        text_config=hf.BertConfig(vocab_size=8, max_position_embeddings=64, **small),
        d_model=32,
        num_queries=10,
        max_text_len=16,
        **{f"{part}_{key}": value for part in ("encoder", "decoder") for key, value in layers.items()},
    )
    hf.GroundingDinoForObjectDetection(detector).save_pretrained(folder / "detector")
    eyes = hf.Sam2HieraDetConfig(
        hidden_size=8,
        image_size=[64, 64],
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[8, 16, 32, 64],
        num_attention_heads_per_stage=[1, 1, 2, 2],
        window_size_per_stage=[8, 4, 8, 4],
        global_attention_blocks=[3],
        window_positional_embedding_background_size=[4, 4],
    )
    vision = hf.Sam2VisionConfig(
        backbone_config=eyes,
        backbone_channel_list=[64, 32, 16, 8],
        backbone_feature_sizes=[[16, 16], [8, 8], [4, 4]],
        fpn_hidden_size=16,
    )
    prompt = {"hidden_size": 16, "image_size": 64, "patch_size": 16, "mask_input_channels": 4}
    decoder = {"hidden_size": 16, "mlp_dim": 16, "num_attention_heads": 2, "iou_head_hidden_dim": 16}
    config = hf.Sam2Config(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    hf.Sam2Model(config).save_pretrained(folder / "masks")
    sides = {"height": 64, "width": 64}
    hf.Sam2ImageProcessor(size=sides, mask_size={"height": 16, "width": 16}).save_pretrained(folder / "masks")
    return folder


def _write_detector(folder: Path) -> None:
    import torch
    import transformers as hf
    from tokenizers import Tokenizer, models, pre_tokenizers

    words = Tokenizer(models.WordLevel(WORDS, unk_token="<unk>"))
    words.pre_tokenizer = pre_tokenizers.Whitespace()
    tokenizer = hf.PreTrainedTokenizerFast(
        tokenizer_object=words, pad_token="<pad>", unk_token="<unk>", model_max_length=4
    )
    half = [0.5, 0.5, 0.5]
    side = {"height": 8 * GRID, "width": 8 * GRID}
    pixels = hf.Owlv2ImageProcessor(size=side, image_mean=half, image_std=half)
    hf.Owlv2Processor(image_processor=pixels, tokenizer=tokenizer).save_pretrained(folder)
    small = {
        "hidden_size": CHANNELS,
        "intermediate_size": CHANNELS,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
    }
    # The text's embedding is that of the first word called its end: `apple`, else of its first word.
    text = small | {"vocab_size": len(WORDS), "max_position_embeddings": 4, "eos_token_id": 2, "bos_token_id": 1}
    vision = small | {"image_size": 8 * GRID, "patch_size": 8}
    model = hf.Owlv2ForObjectDetection(
        hf.Owlv2Config(text_config=text, vision_config=vision, projection_dim=CHANNELS)
    ).eval()
    with torch.no_grad():
        _pass_through(model, ("self_attn.out_proj", "mlp.fc2"))
        eyes = model.owlv2.vision_model.embeddings
        eyes.patch_embedding.weight.zero_()
        # Red less green in the patch's last quarter: the box of a patch lies around the patch's last corner.
        eyes.patch_embedding.weight[0, 0, 4:, 4:] = 1 / 16
        eyes.patch_embedding.weight[0, 1, 4:, 4:] = -1 / 16
        eyes.position_embedding.weight.zero_()
        eyes.class_embedding[:] = torch.tensor([1.0, -1.0] * (CHANNELS // 2))
        model.box_head.dense2.weight.zero_()
        model.box_head.dense2.bias.zero_()
        head = model.class_head
        head.dense0.weight[:] = torch.eye(CHANNELS)
        head.dense0.bias.zero_()
        for part, bias in ((head.logit_shift, -0.5), (head.logit_scale, 9.0)):
            part.weight.zero_()
            part.bias.fill_(bias)
        _teach_words(model, torch)
    model.save_pretrained(folder)


def _teach_words(model: Any, torch: Any) -> None:
    """Make `apple` mean what a red patch looks like, and `pear` the contrary."""
    red = torch.zeros(1, 3, 8 * GRID, 8 * GRID)
    red[:, 0], red[:, 1] = 1, -1
    seen = model.image_embedder(pixel_values=red)[0].reshape(-1, CHANNELS)[0]
    meaning = torch.tensor([1.0, -1.0] * (CHANNELS // 2))
    names = model.owlv2.text_model.embeddings
    names.position_embedding.weight.zero_()
    names.token_embedding.weight.zero_()
    names.token_embedding.weight[WORDS["apple"]] = meaning
    names.token_embedding.weight[WORDS["pear"]] = -meaning
    model.owlv2.text_projection.weight[:] = torch.outer(seen, meaning) / CHANNELS


def _write_masker(folder: Path) -> None:
    import torch
    import transformers as hf

    channels, side = 2 * CHANNELS, 16 * GRID
    half = [0.5, 0.5, 0.5]
    hf.SamImageProcessor(
        size={"longest_edge": side}, pad_size={"height": side, "width": side}, image_mean=half, image_std=half
    ).save_pretrained(folder)
    vision = {
        "hidden_size": CHANNELS,
        "output_channels": channels,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "image_size": side,
        "patch_size": 8,
        "window_size": 0,
        "global_attn_indexes": [0],
        "mlp_dim": CHANNELS,
        "num_pos_feats": CHANNELS,
    }
    prompt = {"hidden_size": channels, "image_size": side, "patch_size": 8, "mask_input_channels": 4}
    decoder = {"hidden_size": channels, "mlp_dim": channels, "num_attention_heads": 2, "iou_head_hidden_dim": channels}
    config = hf.SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    model = hf.SamModel(config).eval()
    with torch.no_grad():
        _pass_through(model, ("attn.proj", "mlp.lin2", "cross_attn_image_to_token.out_proj"))
        eyes = model.vision_encoder
        eyes.pos_embed.zero_()
        patch = eyes.patch_embed.projection
        patch.weight.zero_()
        patch.bias.zero_()
        patch.weight[0, 0], patch.weight[0, 1] = 1 / 64, -1 / 64
        _keep_first(eyes.neck.conv1.weight, 0, 0)
        _keep_first(eyes.neck.conv2.weight, 1, 1)
        model.prompt_encoder.no_mask_embed.weight.zero_()
        for convolution in (model.mask_decoder.upscale_conv1, model.mask_decoder.upscale_conv2):
            convolution.weight.zero_()
            convolution.bias.zero_()
            convolution.weight[0, 0], convolution.weight[0, 1] = 1, -1
        model.mask_decoder.upscale_conv2.weight[1, 0], model.mask_decoder.upscale_conv2.weight[1, 1] = -1, 1
        for head in model.mask_decoder.output_hypernetworks_mlps:
            head.proj_out.weight.zero_()
            head.proj_out.bias[:] = torch.tensor([1.0, -1.0])
    model.save_pretrained(folder)


def _pass_through(model: Any, ends: tuple[str, ...]) -> None:
    """Make the layers whose last steps are called so add nothing to what passes them."""
    for name, part in model.named_modules():
        if name.endswith(ends):
            part.weight.zero_()
            part.bias.zero_()


def _keep_first(weight: Any, row: int, column: int) -> None:
    """Make a convolution (out, in, h, w) hand on the first channel alone."""
    weight.zero_()
    weight[0, 0, row, column] = 1


def fruit_at(column: int, row: int, side_px: int) -> tuple[int, int, int, int]:
    """The box of the fruit that patch (`column`, `row`) sees in a square of `side_px`."""
    patch = side_px / GRID
    x0, y0 = (column + 0.5) * patch, (row + 0.5) * patch
    box = np.array([x0, y0, x0 + patch, y0 + patch])
    return tuple(int(edge) for edge in box)  # type: ignore[return-value]
